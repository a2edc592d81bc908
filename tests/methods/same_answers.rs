//! The same answers whatever the method: every structure, build, traversal, kind of memory, layout, order and kind of
//! kernels that go together, for every robust triangle test, on a device and in the twin, against brute force in the
//! twin, bit for bit: t, u, v and primitive of camera rays and of the rays that leave their hits to a light, mirrored
//! and anywhere; hit or miss where any hit will do; every pixel of a small picture and its numbers of rays. Wavefront
//! kernels are asked for pictures, which is what they are for.
//!
//! What there is and what goes together is looked up in the code's table of options.
//!
//! # Robust tests
//!
//! `exact`, because it promises as much for every ray; those of which [`Intersector::is_robust`] says that t stays
//! right in a triangle's plane; and `plucker`, whose t does not, but no ray here lies in a triangle's plane, and no ray
//! slips between its neighbours. Measured in the twin with 112 x 84 pixels, in 30 structures, builds and traversals on
//! the 5 models: none of 51 million answers to batches was another than brute force's, with `moller-trumbore` and
//! `thesis` neither. Those two are left out all the same: one lets rays slip between neighbours, the other sees no back
//! faces. Which rays break a kd-tree with `watertight` tests/methods/traverse.rs tells.
//!
//! Answers are compared with those of the same triangle test. Others round t otherwise in about half of the hits; where
//! two triangles lie in one place (twins in the bunny, footprints in the floor of the box) only `exact` sees that t is
//! the same.
//!
//! # Three sizes
//!
//! As a rule a spread: each value in each structure, and each triangle test in each traversal, in at least one
//! combination; with `RAYBROOK_THOROUGH=1` each two values of any two options that go together. Each on one model, but
//! those of the mega-kernel with the exact test on every model; and the twin in every structure, build and traversal.
//! Closest hits are asked of each set of kernels, those of secondary rays of one in [`NEXT`], any hits of one in
//! [`ANY`], pictures of one in [`PICTURES`], in a usual run of one in [`WAVEFRONT`] of the wavefront kernels; one in
//! [`OPTIMISED`] is compiled with optimisations.
//!
//! With `RAYBROOK_ALL_COMBINATIONS=1` every combination on every model: thousands of programs to compile.
//! `RAYBROOK_ALL_COMBINATIONS=2/5` runs the second fifth: PoCL compiles one program at a time, so on many cores run
//! many parts, each with a `POCL_CACHE_DIR` of its own ([a
//! record](../docs/record/2026-11-21-pocl-all-combinations.md)). The test program needs nothing of the project then but
//! the models: `RAYBROOK_SHARED` is the folder in which `scenes` and `spd` are; `RAYBROOK_DEVICE` the device.
//!
//! ```text
//! RAYBROOK_ALL_COMBINATIONS=1 cargo test --release --test same_answers -- --nocapture
//! ```

mod combinations;
mod models;

use crate::common::{device, is_thorough, is_usually_taken, unoptimised};
use combinations::{go_together, is_read, is_robust_enough, is_usual, kernel_key, product, spread};
use models::{Answers, Look, Model, Questions, brute_force, models};
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::{
    Choice, Intersector, KdOptions, Kernels, Structure, TraceOptions, Traversal, choices, combine, fewest_changes,
    never_together,
};
use rayon::prelude::*;
use std::collections::HashMap;
use std::num::NonZero;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What decides between the two sizes.
const ALL_COMBINATIONS: &str = "RAYBROOK_ALL_COMBINATIONS";
/// Sizes of the pictures: in the spread, and for all combinations.
const SIZES: [(u32, u32); 2] = [(32, 24), (64, 48)];
/// One in so many sets of the mega-kernel's kernels in the spread is asked for the hits of secondary rays, too; in a
/// usual run half as many, and half as many as the next two say. The ways through a structure are compared for them by
/// tests/methods/traverse.rs.
const NEXT: usize = 3;
/// One in so many for any hits.
const ANY: usize = 3;
/// One in so many combinations of the mega-kernel in the spread renders, too.
const PICTURES: usize = 6;
/// One in so many sets of wavefront kernels in the spread renders in a usual run: each is seven kernels, which trace by
/// the mega-kernel's functions.
const WAVEFRONT: usize = 4;
/// One in so many sets of kernels in the spread is compiled as for users, the others without optimisation.
const OPTIMISED: usize = 6;
/// So many differences are described.
const DESCRIBED: usize = 20;

/// A combination on a model.
#[derive(Clone, Copy)]
struct Job {
    options: TraceOptions,
    model: usize,
    questions: Questions,
}

/// Models, what is due of them, and what came of it.
struct Comparison {
    models: Vec<Model>,
    /// By model and by what answers may depend on.
    expected: HashMap<(usize, Intersector, Look), Answers>,
    tally: Mutex<Tally>,
}

#[derive(Default)]
struct Tally {
    runs: usize,
    rays: u64,
    differences: usize,
    descriptions: Vec<String>,
}

fn robust_tests() -> impl Iterator<Item = Intersector> {
    Intersector::ALL.iter().copied().filter(|&intersector| is_robust_enough(intersector))
}

impl Comparison {
    fn new(size: (u32, u32)) -> Comparison {
        let models = models(size);
        let with =
            |model| robust_tests().flat_map(move |test| Look::all().into_iter().map(move |look| (model, test, look)));
        // Without textures all filters are one.
        let is_other = |key: &(usize, _, Look)| key.2 == models[key.0].look(key.2);
        let keys: Vec<_> = (0..models.len()).flat_map(with).filter(is_other).collect();
        let of_key = |key: (usize, _, _)| (key, models[key.0].expected(&brute_force(key.1, key.2)));
        let expected = keys.into_par_iter().map(of_key).collect();
        Comparison { models, expected, tally: Mutex::default() }
    }

    /// Runs a job on a device, or by the twin.
    fn run(&self, job: &Job, device: Option<&DeviceHandle>, cache: Option<&Cache>) {
        let Job { options, model, questions } = *job;
        let look = self.models[model].look(Look::of(&options.picture));
        let expected = &self.expected[&(model, options.intersector, look)];
        let model = &self.models[model];
        let (rays, (count, texts)) = match model.answers(device, &options, questions, cache) {
            Ok(got) => (got.rays(), model.compare(expected, &got, questions)),
            Err(error) => (0, (1, vec![error.to_string()])),
        };
        let mut tally = self.tally.lock().unwrap();
        tally.runs += 1;
        tally.rays += rays;
        tally.differences += count;
        for text in texts {
            if tally.descriptions.len() < DESCRIBED {
                let who = if device.is_some() { "device" } else { "twin" };
                let text = format!("{}, {who}, {options:?}: {text}", model.name);
                println!("DIFFERENCE: {text}");
                tally.descriptions.push(text);
            }
        }
    }

    /// Runs lists of jobs on the devices in turn, each list with a cache of its own, on all cores.
    fn run_on_devices(&self, lists: &[Vec<Job>], devices: &[DeviceHandle]) {
        let total: usize = lists.iter().map(Vec::len).sum();
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let work = || {
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(jobs) = lists.get(i) else { break };
                let device = &devices[i % devices.len()];
                let folder = tempfile::tempdir().unwrap();
                for job in jobs {
                    self.run(job, Some(device), Some(&Cache::at(folder.path())));
                    let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                    if done.is_multiple_of(100) {
                        println!("{done} of {total}: {} differences", self.tally.lock().unwrap().differences);
                    }
                }
            }
        };
        let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
        std::thread::scope(|scope| (0..threads.min(lists.len())).for_each(|_| drop(scope.spawn(work))));
    }

    /// Every structure, build and traversal with every triangle test, in the twin: on all models, or in the spread, but
    /// with the exact test, each on one.
    fn run_in_the_twin(&self, on_all: bool) {
        let is_read_by_the_twin = |options: &TraceOptions| {
            let plain = TraceOptions { intersector: options.intersector, ..TraceOptions::of(options.kind()) };
            let KdOptions { build, traversal, .. } = options.kd();
            let structure = match options.structure {
                Structure::Kd(_) => Structure::Kd(KdOptions { build, traversal, ..KdOptions::DEFAULT }),
                _ => plain.structure,
            };
            *options == TraceOptions { structure, ..plain }
        };
        let questions = Questions::ALL;
        let models = self.models.len();
        let jobs = product().into_iter().filter(is_read_by_the_twin).enumerate().flat_map(|(i, options)| {
            let is_on_all = on_all || options.intersector == Intersector::Exact;
            let on = (0..models).filter(move |&model| is_on_all || model == i % models);
            on.map(move |model| Job { options, model, questions })
        });
        jobs.collect::<Vec<_>>().par_iter().for_each(|job| self.run(job, None, None));
    }

    fn finish(self, combinations: usize, kernels: usize) {
        let Tally { runs, rays, differences, descriptions } = self.tally.into_inner().unwrap();
        println!(
            "{combinations} combinations of {kernels} sets of kernels, {runs} runs on {} models, {rays} rays, \
             {differences} differences",
            self.models.len()
        );
        assert!(descriptions.is_empty(), "{differences} differences; the first:\n{}", descriptions.join("\n"));
    }
}

/// Lists of the combinations that run the same kernels.
fn by_kernels(combinations: Vec<TraceOptions>) -> Vec<Vec<TraceOptions>> {
    let mut lists: HashMap<String, Vec<TraceOptions>> = HashMap::new();
    combinations.into_iter().for_each(|options| lists.entry(kernel_key(&options)).or_default().push(options));
    let mut lists: Vec<_> = lists.into_iter().collect();
    lists.sort_by(|a, b| a.0.cmp(&b.0));
    lists.into_iter().map(|(_, list)| list).collect()
}

/// The combinations of the spread, each with one model, but those of the mega-kernel with the exact test with all.
/// Wavefront kernels are asked for pictures; of the mega-kernel's one in [`NEXT`] for secondary rays, too, one in
/// [`ANY`] for any hits, and one in [`PICTURES`] for pictures, but none with the exact test, because compiling is what
/// takes long. Other tests render with it.
fn jobs_of_spread(lists: &[Vec<TraceOptions>], models: usize) -> Vec<Vec<Job>> {
    let thinned = if is_thorough() { 1 } else { 2 };
    let is_wavefront = |list: &Vec<TraceOptions>| list[0].picture.kernels == Kernels::Wavefront;
    let jobs = |(i, list): (usize, &Vec<TraceOptions>)| {
        let number = lists[..i].iter().filter(|list| is_wavefront(list)).count();
        if is_wavefront(list) && !is_usually_taken(WAVEFRONT, number) {
            return Vec::new();
        }
        let own = i % models;
        let mut jobs = Vec::new();
        for &options in list {
            let is_exact = options.intersector == Intersector::Exact;
            let is_mega = options.picture.kernels == Kernels::Mega;
            let is_other = options.picture.texture_filter != TraceOptions::DEFAULT.picture.texture_filter;
            for model in (0..models).filter(|&model| is_exact && is_mega || model == own || model == 0 && is_other) {
                // Only the room has textures.
                let picture =
                    model == 0 && is_other || model == own && (!is_mega || !is_exact && i % (thinned * PICTURES) == 0);
                let any = is_mega && i % (thinned * ANY) == 0;
                jobs.push(Job {
                    options,
                    model,
                    questions: Questions { closest: is_mega, next: is_mega && i % (thinned * NEXT) == 1, any, picture },
                });
            }
        }
        jobs
    };
    lists.iter().enumerate().map(jobs).collect()
}

/// All combinations with all models.
fn jobs_of_product(lists: &[Vec<TraceOptions>], models: usize) -> Vec<Vec<Job>> {
    let jobs = |list: &Vec<TraceOptions>| {
        let with = |&options: &TraceOptions, model| {
            let is_mega = options.picture.kernels == Kernels::Mega;
            let questions = Questions { closest: is_mega, next: is_mega, any: is_mega, picture: true };
            Job { options, model, questions }
        };
        (0..models).flat_map(|model| list.iter().map(move |options| with(options, model))).collect()
    };
    lists.iter().map(jobs).collect()
}

/// Which part of all combinations to run: number, counted from 1, and how many parts; `None`: the spread.
fn part() -> Option<(usize, usize)> {
    let text = std::env::var(ALL_COMBINATIONS).ok().filter(|text| !text.is_empty())?;
    let (part, parts) = text.split_once('/').unwrap_or((&text, "1"));
    let numbers = part.parse().ok().zip(parts.parse().ok()).filter(|(part, parts)| (1..=*parts).contains(part));
    Some(numbers.unwrap_or_else(|| panic!("{ALL_COMBINATIONS} is 1, or a part such as 2/5, not '{text}'")))
}

#[test]
fn the_spread_has_every_value_and_every_pair() {
    let (usual, spread) = (spread(is_usual), spread(|_| true));
    let has = |options: &TraceOptions, choice: Choice| {
        let option = choice.option();
        option.value(options) == Some(Some(choice.value())) && option.structures.contains(&options.kind())
    };
    let is_wanted = |choice: &Choice| {
        let needs = fewest_changes(&[*choice]).expect("every value goes together with something");
        let set = combine(&[needs, vec![*choice]].concat()).unwrap();
        is_read(choice) && set.kd().traversal.is_exact() && is_robust_enough(set.intersector)
    };
    let all: Vec<_> = choices().filter(is_wanted).collect();
    let never = never_together();
    let mut pairs = 0;
    for (i, &first) in all.iter().enumerate() {
        assert!(spread.iter().any(|options| has(options, first)), "{first}");
        for &second in all[i + 1..].iter().filter(|second| second.option().name != first.option().name) {
            // What never goes together, or does only because a structure does not read the default.
            if never.iter().any(|n| n.values == [first, second]) || !go_together(first, second) {
                continue;
            }
            pairs += 1;
            let in_one = |options: &TraceOptions| has(options, first) && has(options, second);
            assert!(spread.iter().any(in_one), "{first} {second}");
            assert!(
                !is_usual([first, second].map(|choice| choice.option().name)) || usual.iter().any(in_one),
                "{first} {second} is not in a usual run"
            );
        }
    }
    assert!(pairs > 500 && spread.len() < pairs / 8, "{pairs} pairs in {} combinations", spread.len());
    assert!(usual.len() < spread.len(), "{} of {}", usual.len(), spread.len());
    assert!(spread.iter().chain(&usual).all(|options| options.validate().is_ok()));
}

#[test]
fn a_traversal_that_loses_hits_is_seen() {
    let room = &models(SIZES[0])[0];
    let options = TraceOptions::of_kd(KdOptions { traversal: Traversal::ThesisRestart, ..KdOptions::DEFAULT });
    let questions = Questions::ALL;
    let got = room.answers(None, &options, questions, None).unwrap();
    let same = brute_force(options.intersector, Look::of(&options.picture));
    let (count, texts) = room.compare(&room.expected(&same), &got, questions);
    // It loses none from where all planes are ahead: those of the camera.
    let is_seen = |what: &str| texts.iter().any(|text| text.contains(what));
    assert!(
        count > 100 && is_seen(" second hits of ") && is_seen(" pixels of ") && is_seen(" counts of "),
        "{texts:#?}"
    );
}

#[test]
fn every_combination_gives_the_hits_of_brute_force() {
    let part = part();
    let comparison = Comparison::new(SIZES[usize::from(part.is_some())]);
    let models = comparison.models.len();
    let (lists, jobs) = match part {
        Some((part, parts)) => {
            assert!(models == 5 && device().is_some(), "a model is missing, or the device");
            let lists: Vec<_> = by_kernels(product()).into_iter().skip(part - 1).step_by(parts).collect();
            let jobs = jobs_of_product(&lists, models);
            (lists, jobs)
        }
        None => {
            let lists = by_kernels(if is_thorough() { spread(|_| true) } else { spread(is_usual) });
            let jobs = jobs_of_spread(&lists, models);
            (lists, jobs)
        }
    };
    if part.is_none_or(|(part, _)| part == 1) {
        comparison.run_in_the_twin(part.is_some());
    }
    if let Some(device) = device() {
        let mut devices = vec![device.clone()];
        if part.is_none() {
            devices.resize(OPTIMISED, unoptimised(&device));
        }
        comparison.run_on_devices(&jobs, &devices);
    }
    comparison.finish(lists.iter().map(Vec::len).sum(), lists.len());
}
