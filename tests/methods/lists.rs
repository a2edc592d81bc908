//! Lists of all hits, crossings and walks of hard rays against rational arithmetic, and that wrong ones are found.

use crate::common::device;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::{Intersector, Structure, StructureKind, TraceOptions};
use raybrook_lab::stress::{Case, Exact, Fault, Given, Kind, Method, Question};

/// A kind's case of these tests.
const SEED: u64 = 3;
/// Rays of a case in which methods are to fail.
const RAYS: usize = 200;
const EXACT: TraceOptions = TraceOptions { intersector: Intersector::Exact, ..TraceOptions::DEFAULT };

const QUESTIONS: [Question; 2] = [Question::Lists, Question::Walks];

/// Rays of a kind: few, because of some kinds each meets a hundred triangles.
const LISTED_RAYS: usize = 40;

/// What is wrong, and how many hits are due.
fn wrong_lists(
    question: Question,
    case: &Case,
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
) -> (Vec<(usize, Fault)>, usize) {
    let exact = Exact::new(question, case);
    let faults = exact.faults(&exact.ask(case, options, device, None).unwrap(), true);
    (faults, exact.hit_count(case).unwrap())
}

#[test]
fn lists_crossings_and_walks_are_right_in_every_kind() {
    for question in QUESTIONS {
        let mut hits = 0;
        for kind in question.kinds() {
            let case = kind.case(SEED, LISTED_RAYS);
            for structure in [StructureKind::Kd, StructureKind::Bvh8] {
                let options = TraceOptions { structure: Structure::of(structure), ..EXACT };
                let (faults, due) = wrong_lists(question, &case, &options, None);
                assert_eq!(faults, [], "{} {} (seed {SEED}): {structure}", question.name(), kind.name);
                hits += due;
            }
        }
        assert!(hits > 20_000, "{}: {hits}", question.name());
    }
}

#[test]
fn lists_and_walks_are_right_on_the_device() {
    let Some(device) = device() else { return };
    for (question, kind) in QUESTIONS.into_iter().flat_map(|question| Kind::stacks().map(move |kind| (question, kind)))
    {
        // The kernels of `exact_is_right_on_the_device`, and of `all_hits`.
        let structure = if question == Question::Lists { StructureKind::Bvh2 } else { EXACT.kind() };
        let options = TraceOptions { structure: Structure::of(structure), ..EXACT };
        let (faults, due) = wrong_lists(question, &kind.case(SEED, LISTED_RAYS), &options, Some(&device));
        assert_eq!(faults, [], "{} {} (seed {SEED})", question.name(), kind.name);
        assert!(due > LISTED_RAYS, "{} {}: {due}", question.name(), kind.name);
    }
}

#[test]
fn wrong_lists_and_walks_are_found() {
    use Fault::{Crossings, False, Miss, Order, T, Twice, Weights};
    let cases = [
        (Question::Lists, "moller-trumbore", "stack-copies", Miss),
        (Question::Lists, "moller-trumbore", "stack-floats", Order),
        (Question::Lists, "moller-trumbore", "layers", Order),
        (Question::Lists, "watertight", "stack-shells", T),
        (Question::Lists, "precomputed", "stack-sheets", Weights),
        (Question::Lists, "precomputed", "open-edges", False),
        (Question::Lists, "thesis", "back-faces", Miss),
        (Question::Walks, "moller-trumbore", "stack-edges", Miss),
        (Question::Walks, "thesis", "stack-vertices", Miss),
        (Question::Walks, "watertight", "stack-floats", False),
    ];
    for (question, method, kind, fault) in cases {
        let options = Method::parse(method, TraceOptions::DEFAULT).unwrap().options;
        let case = Kind::find(kind).unwrap().case(SEED, RAYS);
        let (faults, _) = wrong_lists(question, &case, &options, None);
        assert!(faults.iter().any(|&(_, found)| found == fault), "{method} {kind}: {faults:?}");
    }
    // What is exact is spoilt by hand.
    for question in QUESTIONS {
        let case = Kind::find("stack-shells").unwrap().case(SEED, LISTED_RAYS);
        let exact = Exact::new(question, &case);
        let given = exact.ask(&case, &EXACT, None, None).unwrap();
        let Given::Lists(right) = given else { panic!("lists were asked for") };
        let ray = right.hits.iter().position(|hits| hits.len() > 1).unwrap();
        let mut spoilt = right.clone();
        let again = spoilt.hits[ray][0];
        spoilt.hits[ray].insert(1, again);
        assert_eq!(exact.faults(&Given::Lists(spoilt), true), [(ray, Twice)]);
        let mut spoilt = right.clone();
        if let Some(crossings) = &mut spoilt.crossings {
            crossings[ray] += 1;
            assert_eq!(exact.faults(&Given::Lists(spoilt), true), [(ray, Crossings)]);
        }
        assert_eq!(right.crossings.is_some(), question == Question::Lists);
    }
}
