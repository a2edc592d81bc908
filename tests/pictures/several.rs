//! Pictures in blocks, and by several tracers at once, of which some are slow and some fail.

use super::wavefront::{glass_house, one_light};
use crate::common::device;
use raybrook::low_level::film::Film;
use raybrook::low_level::options::{Decisions, PictureOptions, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{
    Picture, PictureBlocks, Renderer, Watcher, open_tracer, render, render_blocks, render_by_several,
};
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::shared::{CameraSample, Light, RenderParams};
use raybrook::low_level::tracer::{
    AllHits, AllHitsJob, Backend, Candidates, CandidatesJob, Finished, Progress, RenderResult, Spent, TraceJob,
    TraceResult,
};
use raybrook::{Error, Result};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The reference in bad shape.
struct Poor {
    inner: Box<dyn Backend>,
    /// Fails after so many calls.
    lives: Option<usize>,
    /// Takes so much longer.
    delay: Duration,
}

impl Backend for Poor {
    fn device_name(&self) -> &str {
        "poor"
    }

    fn options(&self) -> &TraceOptions {
        self.inner.options()
    }

    fn stop_when(&mut self, stop: Arc<AtomicBool>) {
        self.inner.stop_when(stop);
    }

    fn set_lights(&mut self, lights: &[Light]) -> Result<()> {
        self.inner.set_lights(lights)
    }

    fn trace(&mut self, job: &TraceJob, progress: Progress) -> Result<TraceResult> {
        self.inner.trace(job, progress)
    }

    fn trace_all(&mut self, job: &AllHitsJob, progress: Progress) -> Result<AllHits> {
        self.inner.trace_all(job, progress)
    }

    fn find_candidates(&mut self, job: &CandidatesJob, progress: Progress) -> Result<Candidates> {
        self.inner.find_candidates(job, progress)
    }

    fn render(&mut self, params: &RenderParams, samples: &[CameraSample], progress: Progress) -> Result<RenderResult> {
        if self.lives == Some(0) {
            return Err(Error::NoDevice("it is lost".into()));
        }
        self.lives = self.lives.map(|lives| lives - 1);
        let start = Instant::now();
        while start.elapsed() < self.delay {
            progress(0.0);
            std::thread::sleep(Duration::from_millis(5));
        }
        self.inner.render(params, samples, progress)
    }
}

/// What came of a picture.
struct Collected<'a> {
    blocks: &'a PictureBlocks,
    film: Mutex<Film>,
    finished: Mutex<Vec<usize>>,
    lost: Mutex<Vec<String>>,
    fails: bool,
}

impl<'a> Collected<'a> {
    fn new(blocks: &'a PictureBlocks, fails: bool) -> Self {
        let film = Mutex::new(blocks.empty_film());
        Collected { blocks, film, finished: Mutex::default(), lost: Mutex::default(), fails }
    }
}

impl Watcher for Collected<'_> {
    fn done(&self, finished: &Finished) -> Result<()> {
        if self.fails {
            return Err(Error::io("write", "a.partial", std::io::Error::other("the disk is full")));
        }
        self.finished.lock().unwrap().extend(finished.blocks);
        self.blocks.copy(finished, &mut self.film.lock().unwrap())
    }

    fn progress(&self, done: f64) {
        assert!((0.0..=1.0).contains(&done));
    }

    fn lost(&self, name: &str, error: Error) -> Result<()> {
        self.lost.lock().unwrap().push(format!("{name}: {error}"));
        Ok(())
    }
}

/// A wide picture: two areas and four blocks by its error, or five bands.
fn picture(scene: &Scene, samples: Samples) -> Picture {
    Picture { camera: scene.camera.unwrap(), size: (3100, 180), samples, depth: 2, kill_weight: Some(0.0) }
}

fn renderer<'a>(buffers: &Arc<SceneBuffers>, lives: Option<usize>, delay: u64) -> Renderer<'a> {
    let buffers = buffers.clone();
    let open = move || -> Result<(Arc<SceneBuffers>, Box<dyn Backend>)> {
        let inner = open_tracer(None, &buffers, &TraceOptions::DEFAULT, 2, None)?;
        Ok((buffers, Box::new(Poor { inner, lives, delay: Duration::from_millis(delay) })))
    };
    Renderer { name: format!("{lives:?} {delay}"), open: Box::new(open) }
}

#[test]
fn several_tracers_make_the_picture_of_one_whatever_becomes_of_some() {
    let scene = glass_house(one_light());
    let buffers = Arc::new(SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap());
    for samples in [Samples::PerPixel(1), Samples::Error(4.0)] {
        let picture = picture(&scene, samples);
        let blocks = PictureBlocks::new(picture.size, samples, None);
        let mut one = open_tracer(None, &buffers, &TraceOptions::DEFAULT, 2, None).unwrap();
        let whole = render(one.as_mut(), &buffers, &picture, &|_| ()).unwrap();
        let numbers = blocks.numbers();
        let run = |tracers: &[(Option<usize>, u64)], fails: bool| {
            let renderers = tracers.iter().map(|&(lives, delay)| renderer(&buffers, lives, delay)).collect();
            let collected = Collected::new(&blocks, fails);
            let shares = render_by_several(renderers, &picture, &blocks, &numbers, &collected)?;
            let mut finished = collected.finished.into_inner().unwrap();
            finished.sort_unstable();
            assert_eq!(finished, numbers, "each once");
            assert!(collected.film.into_inner().unwrap() == whole.film, "{tracers:?}, {samples:?}");
            assert_eq!(shares.iter().map(|share| share.blocks).sum::<usize>(), numbers.len());
            Ok::<_, Error>((shares, collected.lost.into_inner().unwrap()))
        };
        run(&[(None, 0), (None, 0)], false).unwrap();
        // One that fails at once, and one that fails in the middle.
        let (_, lost) = run(&[(Some(0), 0), (Some(1), 0), (None, 20)], false).unwrap();
        assert!(!lost.is_empty() && lost.iter().all(|why| why.contains("it is lost")), "{lost:?}");
        let error = run(&[(Some(0), 0), (Some(1), 0)], false).unwrap_err();
        assert!(error.to_string().contains("it is lost"), "{error}");
        // A slow one does not hold the end up: it would take this long for one block.
        let slow = 20_000;
        let start = Instant::now();
        let (shares, _) = run(&[(None, slow), (None, 0)], false).unwrap();
        assert!(start.elapsed() < Duration::from_millis(slow), "{:?}", start.elapsed());
        assert_eq!(shares[0].blocks, 0);
        let error = run(&[(None, 0), (None, 0)], true).unwrap_err();
        assert_eq!(error.exit_code(), 5, "{error}");
    }
}

/// Where the device decides, area by area, and where the host does.
#[test]
fn areas_of_a_picture_have_the_same_bits_whoever_decides() {
    let Some(device) = device() else { return };
    let scene = glass_house(one_light());
    for (error, lattice_is_one) in [(1.0, true), (4.0, false)] {
        let picture = picture(&scene, Samples::Error(error));
        let blocks = PictureBlocks::new(picture.size, picture.samples, None);
        let numbers = blocks.numbers();
        assert_eq!(numbers.len() > 2, lattice_is_one);
        let [host, by_device] = [Decisions::Host, Decisions::Device].map(|decisions| {
            let options = TraceOptions {
                picture: PictureOptions { decisions, ..TraceOptions::DEFAULT.picture },
                ..TraceOptions::DEFAULT
            };
            let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
            let mut tracer = open_tracer(Some(&device), &buffers, &options, 2, None).unwrap();
            let (mut told, mut spent) = (0, Spent::default());
            let mut take = |finished: &Finished| {
                told += finished.blocks.len();
                spent.add(&finished.spent);
                Ok(())
            };
            // Area by area, and all at once: a device renders small pictures in one go.
            let mut film = blocks.empty_film();
            for area in numbers.chunks(numbers.len() / 2) {
                let wanted = (area, Some(film));
                let rendered =
                    render_blocks(tracer.as_mut(), &buffers, &picture, &blocks, wanted, &mut take, &|_| ()).unwrap();
                assert_eq!(rendered.adaptive.unwrap().decided_by, decisions);
                film = rendered.film;
            }
            assert_eq!(told, numbers.len());
            let whole = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap();
            assert!(whole.film == film, "error {error}, {decisions:?}");
            let stats = whole.adaptive.unwrap();
            assert_eq!((whole.counts, stats.pixels, stats.decided_by), (spent.counts, spent.refined.pixels, decisions));
            whole
        });
        assert!(host.film == by_device.film, "error {error}");
        assert_eq!(
            (host.counts, host.adaptive.unwrap().pixels),
            (by_device.counts, by_device.adaptive.unwrap().pixels)
        );
    }
}
