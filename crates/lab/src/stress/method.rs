//! Methods by name, for tables of several: "exact", "grid+watertight", "ropes+plucker".

use raybrook::low_level::options::{Accel, Build, Intersector, TraceOptions, Traversal};
use raybrook::{Error, Result};
use serde_json::{Map, Value};

/// A method and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Method {
    /// The parts that differ from the other options.
    pub name: String,
    /// All options.
    pub options: TraceOptions,
}

impl Method {
    /// The method of `options` with the parts that `name` has, joined by '+': structure, build, traversal, triangle test.
    ///
    /// # Errors
    /// [`Error::Option`] when there is no such part, or the parts contradict each other.
    pub fn parse(name: &str, options: TraceOptions) -> Result<Method> {
        let mut method = Method { name: name.to_owned(), options };
        for part in name.split('+') {
            let options = &mut method.options;
            if let Ok(accel) = part.parse() {
                options.accel = accel;
            } else if let Ok(build) = part.parse() {
                options.build = build;
            } else if let Ok(traversal) = part.parse() {
                options.traversal = traversal;
            } else if let Ok(intersector) = part.parse() {
                options.intersector = intersector;
            } else {
                let parts = [Intersector::names(), Accel::names(), Build::names(), Traversal::names()].join(", ");
                return Err(Error::option("--methods", format!("no '{part}'; possible, joined by '+': {parts}")));
            }
        }
        method.options.validate()?;
        Ok(method)
    }

    /// `options` with every other triangle test, structure, build and traversal, one change at a time.
    pub fn all(options: TraceOptions) -> Vec<Method> {
        let intersectors = Intersector::ALL.iter().map(|part| part.name());
        let accels = Accel::ALL.iter().filter(|&&part| part != options.accel).map(|part| part.name());
        let builds = Build::ALL.iter().filter(|&&part| part != options.build).map(|part| part.name());
        let traversals = Traversal::ALL.iter().filter(|&&part| part != options.traversal).map(|part| part.name());
        let names = intersectors.chain(accels).chain(builds).chain(traversals);
        // A build or traversal of kd-trees says nothing to another structure.
        names.filter_map(|name| Method::parse(name, options).ok()).collect()
    }

    /// The structure and the options that differ from the default, as the user types them.
    pub fn arguments(&self) -> Vec<String> {
        let fields = |options: &TraceOptions| match serde_json::to_value(options) {
            Ok(Value::Object(fields)) => fields,
            _ => Map::new(), // cannot be: options are a struct of names and numbers
        };
        let default = fields(&TraceOptions::DEFAULT);
        let changed = fields(&self.options)
            .into_iter()
            .filter(|(name, value)| name == "accel" || default.get(name) != Some(value));
        changed
            .flat_map(|(name, value)| {
                let text = match value {
                    Value::Bool(_) => None, // given at all means true
                    Value::String(name) => Some(name),
                    Value::Array(numbers) => Some(numbers.iter().map(Value::to_string).collect::<Vec<_>>().join(",")),
                    number => Some(number.to_string()),
                };
                [Some(format!("--{}", name.replace('_', "-"))), text].into_iter().flatten()
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_options() {
        let base = TraceOptions::DEFAULT;
        let method = Method::parse("median+restart+plucker", base).unwrap();
        let expected = TraceOptions {
            build: Build::Median,
            traversal: Traversal::Restart,
            intersector: Intersector::Plucker,
            ..base
        };
        assert_eq!(method.options, expected);
        for (name, complaint) in [("best", "no 'best'"), ("grid+ropes", "--traversal"), ("", "no ''")] {
            let message = Method::parse(name, base).unwrap_err().to_string();
            assert!(message.contains(complaint), "{message}");
        }
    }

    #[test]
    fn options_become_arguments() {
        let options = TraceOptions { accel: Accel::Grid, grid_size: Some([4, 5, 6]), ..TraceOptions::DEFAULT };
        let method = Method::parse("plucker", options).unwrap();
        let mut arguments = method.arguments().join(" ");
        for part in ["--accel grid", "--intersector plucker", "--grid-size 4,5,6"] {
            assert!(arguments.contains(part), "'{part}' is missing in: {arguments}");
            arguments = arguments.replace(part, "");
        }
        assert_eq!(arguments.trim(), "");
    }

    #[test]
    fn part_names_are_unique() {
        let all = [Intersector::names(), Accel::names(), Build::names(), Traversal::names()].join(", ");
        let mut names: Vec<_> = all.split(", ").collect();
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
        let methods = Method::all(TraceOptions::DEFAULT);
        assert_eq!(
            methods.len(),
            count - 3,
            "each once; of structure, build and traversal the default is in every one"
        );
    }
}
