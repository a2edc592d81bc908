//! Methods by name: "kd+ropes+plucker".

use crate::error::{Error, Result};
use crate::options::{Accel, Build, Intersector, Request, TraceOptions, Traversal};

/// The option that errors name.
const OPTION: &str = "method";

/// What is left of a choice when the parts are set that `method` has, joined by '+': structure, build, traversal, triangle test, each at
/// most once. What it does not name is chosen later.
///
/// # Errors
/// [`Error::Option`] when there is no such part, or two of one kind.
pub(super) fn parse(method: &str) -> Result<Request> {
    let (mut build, mut traversal) = (None, None);
    let mut request = Request::default();
    for part in method.split('+').map(str::trim) {
        if let Ok(accel) = part.parse::<Accel>() {
            set(&mut request.accel, accel, "structures")?;
        } else if let Ok(part) = part.parse::<Build>() {
            set(&mut build, part, "builds")?;
        } else if let Ok(part) = part.parse::<Traversal>() {
            set(&mut traversal, part, "traversals")?;
        } else if let Ok(intersector) = part.parse::<Intersector>() {
            set(&mut request.intersector, intersector, "triangle tests")?;
        } else {
            let parts = [Accel::names(), Build::names(), Traversal::names(), Intersector::names()].join(", ");
            return Err(Error::option(OPTION, format!("no '{part}'; possible, joined by '+': {parts}")));
        }
    }
    let default = TraceOptions::DEFAULT;
    request.rest.build = build.unwrap_or(default.build);
    request.rest.traversal = traversal.unwrap_or(default.traversal);
    Ok(request)
}

fn set<T: std::fmt::Display>(place: &mut Option<T>, value: T, kind: &str) -> Result<()> {
    match place.replace(value) {
        None => Ok(()),
        Some(first) => {
            let second = place.as_ref().map_or(String::new(), T::to_string);
            Err(Error::option(OPTION, format!("'{first}' and '{second}' are both {kind}; leave one out")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_a_request() {
        let request = parse("kd+ropes+plucker").unwrap();
        assert_eq!((request.accel, request.intersector), (Some(Accel::Kd), Some(Intersector::Plucker)));
        assert_eq!((request.rest.traversal, request.rest.build), (Traversal::Ropes, Build::Sah));
        let request = parse("median").unwrap();
        assert_eq!((request.accel, request.intersector, request.rest.build), (None, None, Build::Median));
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (method, complaint) in [
            ("best", "no 'best'; possible, joined by '+': brute, kd"),
            ("", "no ''"),
            ("kd+", "no ''"),
            ("kd+grid", "'kd' and 'grid' are both structures"),
            ("plucker+kd+exact", "'plucker' and 'exact' are both triangle tests"),
        ] {
            let message = parse(method).unwrap_err().to_string();
            assert!(message.contains(complaint), "{message}");
        }
    }
}
