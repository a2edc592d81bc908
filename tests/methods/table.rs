//! The table of methods: complete, true for every combination of options that depend on each other, and each value of
//! it traces.

use crate::common::{Random, SEED, is_thorough, scene_of, sheet};
use raybrook::low_level::options::{
    Choice, MethodOption, NeverTogether, OPTIONS, TraceOptions, choices, combine, needs, never_together,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{TraceJob, is_hit};
use std::ops::ControlFlow;
use std::sync::Arc;

/// An option's values; `None`, the option left out, where that is not the same as one of them.
fn values_or_none(option: &'static MethodOption) -> Vec<Option<Choice>> {
    let is_other = !option.choices().any(|choice| choice.is_default());
    option.choices().map(Some).chain(is_other.then_some(None)).collect()
}

/// Calls `visit` with every combination of the values of `options` and `chosen`, and whether it is valid, until it has
/// seen enough.
fn sweep(
    options: &[Vec<Option<Choice>>],
    chosen: &mut Vec<Choice>,
    visit: &mut impl FnMut(&[Choice], bool) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let [values, rest @ ..] = options else { return visit(chosen, combine(chosen).is_ok()) };
    values.iter().try_for_each(|value| {
        chosen.extend(value);
        let flow = sweep(rest, chosen, visit);
        chosen.truncate(chosen.len() - value.iter().len());
        flow
    })
}

/// Which pairs are in some valid combination, as a table of [`choices`] by [`choices`].
struct Possible(Vec<Choice>, Vec<bool>);

impl Possible {
    fn new() -> Self {
        let all: Vec<_> = choices().collect();
        let pairs = vec![false; all.len() * all.len()];
        Possible(all, pairs)
    }

    fn index(&self, choice: Choice) -> usize {
        self.0.iter().position(|&c| c == choice).unwrap()
    }

    fn add(&mut self, combination: &[Choice]) {
        let indices: Vec<_> = combination.iter().map(|&choice| self.index(choice)).collect();
        for (i, &first) in indices.iter().enumerate() {
            indices[i + 1..].iter().for_each(|&second| {
                self.1[first * self.0.len() + second] = true;
                self.1[second * self.0.len() + first] = true;
            });
        }
    }

    fn check(&self, never: &[NeverTogether], is_tried: impl Fn(Choice, Choice) -> bool) -> usize {
        let mut count = 0;
        for (i, &first) in self.0.iter().enumerate() {
            for (j, &second) in self.0.iter().enumerate().skip(i + 1) {
                if first.option().name != second.option().name && is_tried(first, second) {
                    let is_possible = self.1[i * self.0.len() + j];
                    let is_listed = never.iter().any(|n| n.values == [first, second]);
                    assert_eq!(is_possible, !is_listed, "{first} {second}");
                    count += 1;
                }
            }
        }
        count
    }
}

/// The options that take names: those of which a value is in the table, and those whose values go together with
/// everything.
fn bound_and_free(never: &[NeverTogether]) -> [Vec<Vec<Option<Choice>>>; 2] {
    let is_bound = |choice: Choice| never.iter().any(|n| n.values.contains(&choice));
    let names = OPTIONS.iter().filter(|option| !option.is_number());
    let (bound, free): (Vec<_>, Vec<_>) = names.partition(|option| option.choices().any(is_bound));
    [bound, free].map(|options| options.into_iter().map(values_or_none).collect())
}

/// Every combination of the names that are in the table, with names of the options beside it, whose values go together
/// with everything, drawn at random.
#[test]
fn names_go_together_as_the_table_says() {
    let never = never_together();
    let [bound, free] = bound_and_free(&never);
    assert!(bound.len() > 8 && free.len() > 3, "{} and {} options", bound.len(), free.len());
    let mut possible = Possible::new();
    let mut random = Random::new(SEED);
    let mut tried = 0;
    let flow = sweep(&bound, &mut Vec::new(), &mut |chosen, is_valid| {
        for _ in 0..2 {
            let drawn = free.iter().filter_map(|values| values[random.below(values.len())]);
            let all: Vec<_> = chosen.iter().copied().chain(drawn).collect();
            assert_eq!(combine(&all).is_ok(), is_valid, "{all:?} (seed {SEED})");
            tried += 1;
            if is_valid {
                possible.add(&all);
            }
        }
        ControlFlow::Continue(())
    });
    assert!(flow.is_continue());
    let pairs = possible.check(&never, |a, b| a.name().is_some() && b.name().is_some());
    assert!(tried > 300_000 && pairs > 600, "{tried} combinations, {pairs} pairs");
}

#[test]
fn numbers_go_together_as_the_table_says() {
    let never = never_together();
    // An option whose values go together with everything stays out of the product: the names' test has shown that of
    // names.
    let [names, _] = bound_and_free(&never);
    let numbers: Vec<_> = choices().filter(|choice| choice.name().is_none()).collect();
    let mut possible = Possible::new();
    for (i, &first) in numbers.iter().enumerate() {
        // Each alone with all names; then, not in a usual run, with another, until some names go with both.
        let others = if is_thorough() { &numbers[i + 1..] } else { &[] };
        for second in std::iter::once(None).chain(others.iter().map(Some)) {
            let mut chosen: Vec<_> = std::iter::once(first).chain(second.copied()).collect();
            let _found = sweep(&names, &mut chosen, &mut |chosen, is_valid| {
                if is_valid {
                    possible.add(chosen);
                }
                if is_valid && second.is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
        }
    }
    let is_tried = |choice: Choice| choice.name().is_none() || names.iter().flatten().any(|&c| c == Some(choice));
    let has_number = |a: Choice, b: Choice| match [a, b].iter().filter(|choice| choice.name().is_none()).count() {
        0 => false,
        1 => true,
        _ => is_thorough(),
    };
    let pairs = possible.check(&never, |a, b| has_number(a, b) && is_tried(a) && is_tried(b));
    assert!(pairs > 200, "{pairs}");
}

fn trace(scene: &Scene, options: &TraceOptions) -> Vec<Hit> {
    let buffers = Arc::new(SceneBuffers::new(scene, options).unwrap());
    let mut random = Random::new(SEED);
    let mut ray = || -> TraceRay {
        let from = 3.0 * random.vec3();
        buffers.trace_ray(from, random.vec3() - from, 0.0, f32::INFINITY)
    };
    let rays: Vec<_> = (0..2000).map(|_| ray()).collect();
    let mut tracer = open_tracer(None, &buffers, options, 1, None).unwrap();
    let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
    tracer.trace(&job, &|_| ()).unwrap().hits
}

#[test]
fn every_value_traces_with_what_it_needs() {
    let scene = scene_of(&sheet(20));
    let expected = trace(&scene, &TraceOptions::DEFAULT);
    let hit_count = expected.iter().filter(|hit| is_hit(hit)).count();
    assert!(hit_count > 500, "{hit_count}");
    for choice in choices() {
        let options =
            combine(&[needs(choice), vec![choice]].concat()).unwrap_or_else(|error| panic!("{choice}: {error}"));
        let hits = trace(&scene, &options);
        if options.intersector == TraceOptions::DEFAULT.intersector && options.kd().traversal.is_exact() {
            let bits = |hits: &[Hit]| bytemuck::cast_slice::<_, u32>(hits).to_vec();
            assert_eq!(bits(&hits), bits(&expected), "{choice} (seed {SEED})");
        } else if options.intersector.is_robust() && options.kd().traversal.is_exact() {
            // Another triangle test rounds t, u and v otherwise.
            let differ = hits.iter().zip(&expected).filter(|(a, b)| a.primitive != b.primitive).count();
            assert_eq!(differ, 0, "{choice} (seed {SEED})");
        } else {
            assert!(hits.iter().any(is_hit), "{choice} (seed {SEED})");
        }
    }
}
