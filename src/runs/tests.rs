//! Runs against the whole batch, and journals of them.

use super::*;
use crate::random::Random;
use crate::reference::ReferenceBackend;
use crate::scene::Scene;
use std::path::Path;
use std::sync::Arc;

const RAYS: usize = 1037;
const LENGTH: usize = 100;
const ALL: [Asked; 6] =
    [Asked::Closest, Asked::Any, Asked::All(u32::MAX), Asked::All(2), Asked::Count, Asked::Crossings];

/// A scene of some triangles, and rays through it: with second ones, and some that tracing space cannot hold.
struct Bench {
    scene: Scene,
    buffers: Arc<SceneBuffers>,
    given: RayBatch,
}

impl Bench {
    fn new() -> Bench {
        let mut random = Random::new(11);
        let mut positions = Vec::new();
        for _ in 0..60 {
            let corner = random.vec3();
            positions
                .extend([corner, corner + random.vec3() * 0.4, corner + random.vec3() * 0.4].map(|p| p.to_array()));
        }
        let triangles: Vec<[u32; 3]> = (0..60).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let scene = Scene::from_mesh(&positions, &triangles).unwrap();
        let buffers = Arc::new(SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap());
        let is_far = |i: usize| i % 97 == 5;
        let far = ([0.5, 0.5, -3e38], [0.0, 0.0, 1.0]);
        let mut near = || ((random.vec3() * 2.0 - 0.5).to_array(), random.direction().to_array());
        let rays = (0..RAYS).map(|i| if is_far(i) { far } else { near() });
        let (origins, directions) = rays.unzip();
        let given = RayBatch {
            origins,
            directions,
            t_max: Some((0..RAYS).map(|i| if i % 3 == 0 { 0.7 } else { f32::INFINITY }).collect()),
            next_directions: Some((0..RAYS).map(|_| random.direction().to_array()).collect()),
            ..RayBatch::default()
        };
        Bench { scene, buffers, given }
    }

    fn rays(&self) -> TracingBatch {
        let given = &self.given;
        let t_max = |i: usize| given.t_max.as_ref().unwrap()[i];
        let ray = |i: usize| (given.origins[i].into(), given.directions[i].into(), 0.0, t_max(i));
        let next = |i: usize| given.next_directions.as_ref().unwrap()[i].into();
        self.buffers.batch(RAYS, ray, Some(&next))
    }

    fn runs(&self) -> Runs {
        Runs::of_length(RAYS, LENGTH)
    }

    fn id(&self, asked: Asked) -> BatchId {
        BatchId::new(&self.scene, (&self.given, self.runs()), asked, &TraceOptions::DEFAULT)
    }

    fn trace(&self, asked: Asked, runs: Runs, wanted: &[usize]) -> Vec<TracedRuns> {
        self.trace_at(&mut None, asked, (runs, wanted))
    }

    fn trace_at(&self, pace: &mut Pace, asked: Asked, wanted: (Runs, &[usize])) -> Vec<TracedRuns> {
        let mut tracer = ReferenceBackend::new(self.buffers.clone(), TraceOptions::DEFAULT);
        let (rays, mut traced) = (self.rays(), Vec::new());
        let job = BatchJob { given: &self.given, rays: RunRays::Made(&rays), asked, budget: MemoryBudget::UNLIMITED };
        let mut done = |now| {
            traced.push(now);
            Ok(())
        };
        trace_runs_at(pace, (&mut tracer, &self.buffers), &job, wanted, &mut done, &|_| ()).unwrap();
        traced
    }

    /// What is written of these pieces.
    fn written(&self, pieces: &[Answers], asked: Asked) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hits.npz");
        write_answers(&path, pieces, (asked, asked == Asked::Closest), [None; 2]).unwrap();
        std::fs::read(path).unwrap()
    }
}

fn create(path: &Path, id: &BatchId, part: Option<Part>, traced: &[TracedRuns]) {
    let mut journal = BatchJournal::create(path, id, part).unwrap();
    traced.iter().for_each(|traced| journal.append(traced).unwrap());
}

/// The runs of a journal in their order, with what was found in them.
fn read(path: &Path, id: &BatchId) -> Result<(Vec<usize>, Vec<Answers>, Found)> {
    let (mut all, mut found) = (Vec::new(), Found::default());
    read_kept_runs(path, Some(id), &mut |_, entry, answers| {
        found.add(&entry.found);
        all.push((entry.run, answers));
        Ok(())
    })?;
    all.sort_by_key(|(run, _)| *run);
    let (runs, answers) = all.into_iter().unzip();
    Ok((runs, answers, found))
}

#[test]
fn runs_in_any_order_have_the_bits_of_the_whole_batch() {
    let bench = Bench::new();
    assert!(bench.rays().extreme.len() > 5 && bench.runs().count() == 11);
    let folder = tempfile::tempdir().unwrap();
    for (number, asked) in ALL.into_iter().enumerate() {
        let whole = bench.trace(asked, Runs::of_length(RAYS, RAYS), &[0]);
        assert_eq!(whole.len(), 1);
        let path = folder.path().join(number.to_string());
        let mut traced = bench.trace(asked, bench.runs(), &[3, 4, 5, 6, 8, 10]);
        traced.extend(bench.trace(asked, bench.runs(), &[0, 1, 2, 7, 9]));
        let of_runs: usize = traced.iter().map(|traced| traced.runs.len()).sum();
        assert_eq!(of_runs, 11);
        create(&path, &bench.id(asked), None, &traced);
        let (runs, answers, found) = read(&path, &bench.id(asked)).unwrap();
        assert!(runs.into_iter().eq(0..11) && found == whole[0].found[0], "{asked}");
        assert!(found.rays_that_hit > 20, "{asked}: {found:?}");
        assert!(bench.written(&answers, asked) == bench.written(&[whole[0].answers.clone()], asked), "{asked}");
    }
}

#[test]
fn many_runs_are_traced_together_where_that_changes_nothing() {
    let bench = Bench::new();
    let all: Vec<usize> = (0..11).collect();
    let packets = TraceOptions { packet_size: PacketSize::Sixteen, ..TraceOptions::DEFAULT };
    assert!(bench.trace(Asked::Closest, bench.runs(), &all).len() < 11);
    let rays = bench.rays();
    for asked in ALL {
        let job = BatchJob { given: &bench.given, rays: RunRays::Made(&rays), asked, budget: MemoryBudget::UNLIMITED };
        assert!(job.go_together(&TraceOptions::DEFAULT));
        assert_eq!(job.go_together(&packets), asked != Asked::Any);
    }
    assert_eq!(next_most(4, Duration::from_secs(2)), 2);
    assert_eq!(next_most(4, Duration::from_millis(500)), 8);
    assert_eq!([next_most(2, Duration::ZERO), next_most(1, Duration::from_secs(99))], [MOST_TOGETHER, 1]);
}

#[test]
fn parts_have_every_run_once() {
    for rays in [0, 1, LENGTH, RAYS] {
        let runs = Runs::of_length(rays, LENGTH);
        assert_eq!((0..runs.count()).map(|run| runs.len_of(run)).sum::<usize>(), rays);
        for of in [1, 2, 3, 16] {
            let mut all: Vec<usize> = (1..=of).flat_map(|number| runs.of_part(Part { number, of })).collect();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..runs.count()));
        }
    }
}

#[test]
fn journals_of_other_batches_are_refused() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.partial");
    let id = bench.id(Asked::Closest);
    create(&path, &id, Some(Part { number: 2, of: 3 }), &[]);
    let bytes = std::fs::read(&path).unwrap();
    let refusal =
        |id: &BatchId, part| BatchJournal::open(&path, id, part, &mut |_, _, _| Ok(())).unwrap_err().to_string();
    let part = Some(Part { number: 2, of: 3 });
    assert!(refusal(&id, None).contains("is of part 2/3, not of the whole batch"));
    assert!(refusal(&bench.id(Asked::All(7)), part).contains("its question is closest hits, not 7 hits"));
    for (change, says) in [
        ((|bench| bench.given.origins[RAYS - 1][2] = -0.0) as fn(&mut Bench), "its rays are others"),
        (|bench| bench.given.t_max = None, "its rays are others"),
        (|bench| bench.given.next_directions = None, "its rays are others"),
        (|bench| bench.scene.positions[4].x += 1.0, "its scene has other triangles"),
    ] {
        let mut other = Bench::new();
        change(&mut other);
        let message = refusal(&other.id(Asked::Closest), part);
        assert!(message.contains("of another batch") && message.contains(says), "{message}");
    }
    // What batches do not read may be another.
    let mut other = Bench::new();
    other.scene.materials[0].diffuse *= 0.5;
    other.scene.background.top.x += 1.0;
    other.scene.lights.push(crate::scene::Light::directional(glam::Vec3::Y, glam::Vec3::ONE));
    assert_eq!(other.id(Asked::Closest).difference(&id), None);
    let inexact = TraceOptions { intersector: crate::options::Intersector::Plucker, ..TraceOptions::DEFAULT };
    let inexact = BatchId::new(&bench.scene, (&bench.given, bench.runs()), Asked::Closest, &inexact);
    assert!(refusal(&inexact, part).contains("its method is none, not"));
    assert!(BatchJournal::open(&path, &id, part, &mut |_, _, _| Ok(())).is_ok());
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

#[test]
fn damaged_runs_are_left_out_and_records_must_hold_what_they_say() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    for asked in [Asked::Closest, Asked::All(u32::MAX), Asked::Count] {
        let path = folder.path().join(asked.to_string());
        let id = bench.id(asked);
        create(&path, &id, None, &bench.trace(asked, bench.runs(), &[0, 1, 2]));
        let bytes = std::fs::read(&path).unwrap();
        let mut damaged = bytes.clone();
        let last = damaged.len() - 40;
        damaged[last] ^= 4;
        std::fs::write(&path, &damaged).unwrap();
        assert_eq!(read(&path, &id).unwrap().0, [0, 1], "{asked}");
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(read(&path, &id).unwrap().0.len() < 2, "{asked}");
        // Whole records of something else.
        let entry =
            |run: usize| format!("{{\"run\":{run},\"found\":{{\"rays_that_hit\":0,\"hits\":0}},\"took\":{}}}", took());
        for (run, answers) in [(0, 3), (99, 4), (0, 0), (0, 1 << 14)] {
            std::fs::write(&path, &bytes).unwrap();
            let (mut journal, _) = crate::io::journal::Journal::open(&path, |_| Ok(())).unwrap();
            let (entry, answers) = (entry(run), vec![0; answers]);
            journal.append(&[b"R", &(entry.len() as u32).to_le_bytes(), entry.as_bytes(), &answers]).unwrap();
            let message = read(&path, &id).unwrap_err().to_string();
            assert!(message.contains("does not hold what it says"), "{message}");
        }
    }
}

fn took() -> String {
    serde_json::to_string(&Took::default()).unwrap()
}

#[test]
fn runs_from_journals_make_the_file_of_the_whole_batch() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    for asked in ALL {
        let traced = bench.trace(asked, bench.runs(), &(0..11).collect::<Vec<_>>());
        let pieces: Vec<Answers> = traced.iter().map(|traced| traced.answers.clone()).collect();
        let path = |name: &str| folder.path().join(format!("{asked} {name}"));
        let create_part = |name: &str, traced: &[TracedRuns]| create(&path(name), &bench.id(asked), None, traced);
        let one_by_one: Vec<_> = (0..11).map(|run| bench.trace(asked, bench.runs(), &[run]).remove(0)).collect();
        create_part("late", &one_by_one[4..]);
        create_part("early", &one_by_one[..6]);
        let mut stored = StoredRuns::default();
        assert_eq!(stored.add(&path("late")).unwrap().1, 0);
        assert!((0..4).all(|run| !stored.has(run)) && stored.len() == 7);
        assert_eq!(stored.add(&path("early")).unwrap().1, 2);
        assert_eq!(stored.len(), 11);
        let all = traced.iter().flat_map(|traced| &traced.found);
        assert_eq!(stored.found().hits, all.map(|found| found.hits).sum::<u64>());
        let output = folder.path().join("hits.npz");
        stored.write(&output).unwrap();
        assert!(std::fs::read(&output).unwrap() == bench.written(&pieces, asked), "{asked}");
        // A journal that changes meanwhile is named, and the output stays as it was.
        let mut bytes = std::fs::read(path("late")).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        std::fs::write(path("late"), bytes).unwrap();
        std::fs::write(&output, "old").unwrap();
        let message = stored.write(&output).unwrap_err().to_string();
        assert!(message.contains("late: the journal is not what it was"), "{message}");
        assert_eq!(std::fs::read(&output).unwrap(), b"old");
    }
}

#[test]
fn a_run_with_other_answers_than_before_is_refused() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let [first, other] = ["first", "other"].map(|name| folder.path().join(name));
    for (asked, is_same) in [(Asked::Closest, false), (Asked::Any, true)] {
        let mut traced = bench.trace(asked, bench.runs(), &[3]).remove(0);
        let _ = std::fs::remove_file(&first);
        let _ = std::fs::remove_file(&other);
        create(&first, &bench.id(asked), None, &[traced.clone()]);
        let hit = traced.answers.hits.iter_mut().find(|hit| is_hit(hit)).unwrap();
        hit.primitive ^= 1;
        create(&other, &bench.id(asked), None, &[traced]);
        let mut stored = StoredRuns::default();
        stored.add(&first).unwrap();
        let added = stored.add(&other).map(|(_, doubled)| doubled);
        match is_same {
            true => assert_eq!(added.unwrap(), 1, "which triangle an any-hit ray names means nothing"),
            false => {
                let message = added.unwrap_err().to_string();
                assert!(message.contains("other: run 3 has other answers here"), "{message}");
            }
        }
    }
}

#[test]
fn a_device_whose_pace_is_known_does_not_begin_with_little() {
    let (bench, mut pace) = (Bench::new(), None);
    let lengths = |traced: Vec<TracedRuns>| traced.iter().map(|traced| traced.runs.len()).collect::<Vec<_>>();
    let first = lengths(bench.trace_at(&mut pace, Asked::Closest, (bench.runs(), &[0, 1, 2, 3])));
    assert_eq!(first[0], 1, "nobody knows yet");
    let known = pace.unwrap();
    let then = lengths(bench.trace_at(&mut pace, Asked::Closest, (bench.runs(), &[4, 5, 6, 7])));
    assert_eq!(then[0], known.min(4) as usize, "{then:?}");
}
