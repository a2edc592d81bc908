//! Pictures in blocks, and by several tracers at once, of which some are slow and some fail.

use super::wavefront::{glass_house, one_light};
use crate::common::device;
use raybrook::low_level::film::Film;
use raybrook::low_level::options::{Decisions, PictureOptions, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{
    FallBack, Picture, PictureBlocks, open_tracer, render, render_blocks, render_by_several,
};
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::several::{DeviceTracer, Devices, OpenTracer, Takeover, Watcher};
use raybrook::low_level::shared::{CameraSample, Light, RenderParams};
use raybrook::low_level::tracer::{
    AllHits, AllHitsJob, Backend, Candidates, CandidatesJob, Finished, LostDevice, Progress, RenderResult, Spent,
    TraceJob, TraceResult,
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
            let [device, call, code, hint] = ["poor", "clFinish", "it is lost", ""].map(str::to_owned);
            return Err(Error::OpenCl { device, call, code, hint });
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
    lost: Mutex<Vec<(Takeover, String)>>,
    fails: bool,
}

impl<'a> Collected<'a> {
    fn new(blocks: &'a PictureBlocks, fails: bool) -> Self {
        let film = Mutex::new(blocks.empty_film());
        Collected { blocks, film, finished: Mutex::default(), lost: Mutex::default(), fails }
    }
}

impl Collected<'_> {
    fn take(&self, finished: &Finished) -> Result<()> {
        if self.fails {
            return Err(Error::io("write", "a.partial", std::io::Error::other("the disk is full")));
        }
        self.finished.lock().unwrap().extend(finished.blocks);
        self.blocks.copy(finished, &mut self.film.lock().unwrap())
    }
}

impl Watcher for Collected<'_> {
    fn progress(&self, done: f64) {
        assert!((0.0..=1.0).contains(&done));
    }

    fn lost(&self, (_, name): (usize, &str), error: Error, takeover: Takeover) -> Result<()> {
        self.lost.lock().unwrap().push((takeover, format!("{name}: {error}")));
        Ok(())
    }
}

/// A wide picture: two areas and four blocks by its error, or five bands.
fn picture(scene: &Scene, samples: Samples) -> Picture {
    Picture { camera: scene.camera.unwrap(), size: (3100, 180), samples, depth: 2, kill_weight: Some(0.0) }
}

fn poor(buffers: &Arc<SceneBuffers>, lives: Option<usize>, delay: u64) -> Box<Poor> {
    let inner = open_tracer(None, buffers, &TraceOptions::DEFAULT, 2, None).unwrap();
    Box::new(Poor { inner, lives, delay: Duration::from_millis(delay) })
}

fn tracer<'a>(buffers: &Arc<SceneBuffers>, lives: Option<usize>, delay: u64) -> DeviceTracer<'a> {
    let buffers = buffers.clone();
    let open = move || {
        let tracer = OpenTracer::Own(poor(&buffers, lives, delay));
        Ok((buffers, tracer))
    };
    DeviceTracer { name: format!("{lives:?} {delay}"), is_processor: true, open: Box::new(open) }
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
        let run_with = |tracers: &[(Option<usize>, u64)], last_resort: Option<(Option<usize>, u64)>, fails: bool| {
            let tracer = |(lives, delay): (Option<usize>, u64)| tracer(&buffers, lives, delay);
            let devices = tracers.iter().copied().map(tracer).collect();
            let devices = Devices { devices, last_resort: last_resort.map(tracer) };
            let collected = Collected::new(&blocks, fails);
            let take = |finished: &Finished| collected.take(finished);
            let shares = render_by_several(devices, &picture, (&blocks, &numbers), &take, &collected)?;
            let mut finished = collected.finished.into_inner().unwrap();
            finished.sort_unstable();
            assert_eq!(finished, numbers, "each once");
            assert!(collected.film.into_inner().unwrap() == whole.film, "{tracers:?}, {samples:?}");
            assert_eq!(shares.iter().map(|share| share.pieces).sum::<usize>(), numbers.len());
            Ok::<_, Error>((shares, collected.lost.into_inner().unwrap()))
        };
        let run = |tracers: &[(Option<usize>, u64)], fails: bool| run_with(tracers, None, fails);
        run(&[(None, 0), (None, 0)], false).unwrap();
        // One that fails at once, and one that fails in the middle.
        let (_, lost) = run(&[(Some(0), 0), (Some(1), 0), (None, 20)], false).unwrap();
        let is_told =
            |(takeover, why): &(Takeover, String)| *takeover == Takeover::OtherDevices && why.contains("it is lost");
        assert!(!lost.is_empty() && lost.iter().all(is_told), "{lost:?}");
        let both = [(Some(0), 0), (Some(1), 0)];
        let error = run(&both, false).unwrap_err();
        assert!(error.to_string().contains("it is lost"), "{error}");
        // Where both fail, something else does the rest, unless it fails, too.
        let (shares, lost) = run_with(&both, Some((None, 0)), false).unwrap();
        assert_eq!(lost.iter().map(|lost| lost.0).collect::<Vec<_>>(), [Takeover::OtherDevices, Takeover::LastResort]);
        assert!(shares.len() == 3 && shares[2].pieces > 0, "{shares:?}");
        let (shares, lost) = run_with(&[(None, 0), (Some(0), 0)], Some((Some(0), 0)), false).unwrap();
        assert!(shares.len() == 2 && lost.len() <= 1, "nobody needs it: {shares:?}, {lost:?}");
        let error = run_with(&both, Some((Some(0), 5)), false).unwrap_err();
        assert!(error.to_string().contains("it is lost"), "{error}");
        // A slow one does not hold the end up: it would take this long for one block.
        let slow = 20_000;
        let start = Instant::now();
        let (shares, _) = run(&[(None, slow), (None, 0)], false).unwrap();
        assert!(start.elapsed() < Duration::from_millis(slow), "{:?}", start.elapsed());
        assert_eq!(shares[0].pieces, 0);
        let error = run(&[(None, 0), (None, 0)], true).unwrap_err();
        assert_eq!(error.exit_code(), 5, "{error}");
    }
}

/// A device that is lost in the middle: what it has not done the reference does.
#[test]
fn the_reference_takes_the_place_of_a_lost_device() {
    let scene = glass_house(one_light());
    let buffers = Arc::new(SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap());
    let mut lights = buffers.lights.clone();
    lights.iter_mut().for_each(|light| light.intensity.x *= 0.5);
    for samples in [Samples::PerPixel(1), Samples::Error(4.0)] {
        let picture = picture(&scene, samples);
        let mut one = open_tracer(None, &buffers, &TraceOptions::DEFAULT, 2, None).unwrap();
        one.set_lights(&lights).unwrap();
        let whole = render(one.as_mut(), &buffers, &picture, &|_| ()).unwrap();
        for lives in [0, 1] {
            let told = Arc::new(Mutex::new(Vec::new()));
            let on_loss = {
                let told = told.clone();
                Box::new(move |lost: &LostDevice| told.lock().unwrap().push(lost.clone()))
            };
            let mut guarded = FallBack::new(poor(&buffers, Some(lives), 0), &buffers, on_loss);
            guarded.set_lights(&lights).unwrap();
            let blocks = PictureBlocks::new(picture.size, samples, None);
            let wanted = (&blocks.numbers()[..], Some(blocks.empty_film()));
            let rendered =
                render_blocks(&mut guarded, &buffers, &picture, &blocks, wanted, &mut |_| Ok(()), &|_| ()).unwrap();
            assert!(rendered.film == whole.film, "{lives} {samples:?}");
            let told = told.lock().unwrap();
            assert!(told.len() <= 1 && guarded.lost() == told.first(), "{told:?}");
            assert!(lives > 0 || told[0].device == "poor" && told[0].error.contains("it is lost"), "{told:?}");
            assert_eq!(guarded.device_name(), if told.is_empty() { "poor" } else { "reference" });
        }
    }
    // What is no loss remains an error.
    let mut guarded = FallBack::new(poor(&buffers, Some(0), 0), &buffers, Box::new(|_| panic!("nothing is lost")));
    let error = guarded.set_lights(&[]).unwrap_err();
    assert!(error.exit_code() == 2 && guarded.lost().is_none(), "{error}");
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
