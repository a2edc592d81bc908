//! Measuring what is fastest: every candidate with the same answers, on the reference and on a device.

use raybrook::low_level::choose::SceneSize;
use raybrook::low_level::choose::tune::{Plan, SceneTuning, Tuning, cubes, scene_of, tune_scene};
use raybrook::low_level::options::{PacketSize, StructureKind};
use raybrook::low_level::scene::Scene;
use std::cell::RefCell;

const RAYS: u32 = 300;
const ROUNDS: u32 = 2;

fn plan(structures: &[StructureKind]) -> Plan {
    Plan { structures: structures.to_vec(), rays: RAYS, rounds: ROUNDS, seed: crate::common::SEED, memory: None }
}

fn assert_measured(tuning: &SceneTuning, candidates: usize) {
    assert_eq!(tuning.measured.len(), candidates);
    assert_eq!(tuning.differing(), 0, "{tuning:?}");
    assert_eq!(tuning.rays[0], 256, "the square of a power of two below {RAYS}");
    assert!(tuning.rays[1] > 0 && tuning.rays[1] == tuning.rays[2], "{:?}", tuning.rays);
    for measured in &tuning.measured {
        assert!(measured.kernel_s.iter().all(|&seconds| seconds >= 0.0), "{measured:?}");
        assert!(measured.ratio.is_finite() && measured.ratio > 0.0, "{measured:?}");
    }
    assert_eq!(tuning.measured[0].ratio, 1.0);
}

#[test]
fn every_structure_is_measured_on_the_reference_with_the_same_answers() {
    let steps = RefCell::new(Vec::new());
    let progress = |what: &str| steps.borrow_mut().push(what.to_owned());
    let scene = scene_of(SceneSize::Tiny).unwrap();
    let tiny = tune_scene(None, None, ("cubes", &scene), &plan(StructureKind::ALL), &progress).unwrap();
    // Every structure, and packets in two of them.
    assert_measured(&tiny, StructureKind::ALL.len() + 2);
    assert_eq!((tiny.size, tiny.measured[0].candidate.structure), (SceneSize::Tiny, StructureKind::Bvh2));
    assert_eq!(steps.borrow().len(), tiny.measured.len() + ROUNDS as usize);

    let small = tune_scene(None, None, ("25 cubes", &cubes(25).unwrap()), &plan(StructureKind::ALL), &|_| ()).unwrap();
    assert_eq!(small.measured[0].candidate.structure, StructureKind::Kd);
    let tunings = Tuning::of(&[small, tiny]);
    assert_eq!(tunings.iter().map(|tuning| tuning.size).collect::<Vec<_>>(), [SceneSize::Tiny, SceneSize::Small]);
    assert_eq!((tunings[0].triangle_counts[0], tunings[1].triangle_counts[0]), (38, 302));
}

#[test]
fn a_device_gives_the_same_answers_in_packets_and_without() {
    let Some(device) = crate::common::device() else { return };
    let scene = scene_of(SceneSize::Small).unwrap();
    let tuning =
        tune_scene(Some(&device), None, ("balls", &scene), &plan(&[StructureKind::Kd, StructureKind::Bvh8]), &|_| ())
            .unwrap();
    for accel in [StructureKind::Kd, StructureKind::Bvh8] {
        let sizes = tuning.measured.iter().filter(|measured| measured.candidate.structure == accel);
        assert_eq!(sizes.count(), PacketSize::ALL.len());
    }
    assert_measured(&tuning, tuning.measured.len());
}

#[test]
fn what_cannot_be_measured_is_an_error_or_measures_nothing() {
    let tune = |scene: &Scene, plan: &Plan| tune_scene(None, None, ("a scene", scene), plan, &|_| ());
    let scene = scene_of(SceneSize::Tiny).unwrap();
    for rays in [0, Plan::LEAST_RAYS - 1, Plan::MOST_RAYS + 1] {
        let error = tune(&scene, &Plan { rays, ..plan(&[]) }).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("rays"), "{error}");
    }
    // Nothing to see: camera rays alone, all of which miss.
    let nothing = tune(&Scene::default(), &plan(&[StructureKind::Kd])).unwrap();
    assert_eq!((nothing.rays, nothing.triangle_count, nothing.differing()), ([256, 0, 0], 0, 0));
    assert!(nothing.measured.iter().all(|measured| measured.mrays_per_s[1] == 0.0 && measured.ratio.is_finite()));
}
