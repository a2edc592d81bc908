//! Methods by name, for tables of several: "exact", "grid+watertight", "ropes+plucker".

use raybrook::Result;
use raybrook::low_level::choose::Request;
use raybrook::low_level::options::{Build, Intersector, StructureKind, TraceOptions, Traversal, parse_method};

/// A method and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Method {
    /// The parts that differ from the other options.
    pub name: String,
    /// All options.
    pub options: TraceOptions,
}

impl Method {
    /// The method of `options` with the parts that `name` has, joined by '+': structure, build, traversal, triangle
    /// test.
    ///
    /// # Errors
    /// [`raybrook::Error::Option`] when there is no such part, or the parts contradict each other.
    pub fn parse(name: &str, options: TraceOptions) -> Result<Method> {
        let mut request = Request::of(&options);
        parse_method(name)?.into_iter().for_each(|choice| request.give(choice));
        Ok(Method { name: name.to_owned(), options: request.with_structure(options.kind())? })
    }

    /// `options` with every other triangle test, structure, build and traversal, one change at a time.
    pub fn all(options: TraceOptions) -> Vec<Method> {
        let kd = options.kd();
        let intersectors = Intersector::ALL.iter().map(|part| part.name());
        let kinds = StructureKind::ALL.iter().filter(|&&part| part != options.kind()).map(|part| part.name());
        let builds = Build::ALL.iter().filter(|&&part| part != kd.build).map(|part| part.name());
        let traversals = Traversal::ALL.iter().filter(|&&part| part != kd.traversal).map(|part| part.name());
        let names = intersectors.chain(kinds).chain(builds).chain(traversals);
        // A build or traversal of kd-trees says nothing to another structure.
        names.filter_map(|name| Method::parse(name, options).ok()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::low_level::options::{KdOptions, Structure};

    #[test]
    fn names_become_options() {
        let base = TraceOptions::DEFAULT;
        let method = Method::parse("median+restart+plucker", base).unwrap();
        let kd = KdOptions { build: Build::Median, traversal: Traversal::Restart, ..KdOptions::DEFAULT };
        let expected = TraceOptions { structure: Structure::Kd(kd), intersector: Intersector::Plucker, ..base };
        assert_eq!(method.options, expected);
        for (name, complaint) in [("best", "no 'best'"), ("grid+ropes", "traversal"), ("", "no ''")] {
            let message = Method::parse(name, base).unwrap_err().to_string();
            assert!(message.contains(complaint), "{message}");
        }
    }

    #[test]
    fn a_table_has_every_part_once() {
        let parts = Intersector::ALL.len() + StructureKind::ALL.len() + Build::ALL.len() + Traversal::ALL.len();
        let methods = Method::all(TraceOptions::DEFAULT);
        assert_eq!(methods.len(), parts - 3, "of structure, build and traversal the default is in every one");
    }

    #[test]
    fn what_else_is_set_stays() {
        let kd = KdOptions { leaf_size: Some(3), ..KdOptions::DEFAULT };
        let base = TraceOptions { structure: Structure::Kd(kd), ..TraceOptions::DEFAULT };
        let octree = Method::parse("octree", base).unwrap().options;
        assert_eq!((octree.kind(), octree.structure.leaf_size()), (StructureKind::Octree, Some(3)));
    }
}
