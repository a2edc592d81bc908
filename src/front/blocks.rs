//! Pictures in blocks, for programs that share them out themselves.

use super::tracer::Tracer;
use super::view::{Frame, View};
use crate::error::{Error, Result};
use crate::io::film::Film;
use crate::parallel::{lock, unlocked};
use crate::renderer::{self, PictureBlocks, render_blocks};
use crate::scene::Scene;
use crate::tracer::Finished;
use std::sync::Mutex;

impl View {
    /// How the picture of `scene` is cut into blocks, which [`Tracer::render_blocks`] renders. That depends on the
    /// picture's size, samples and part alone, so that all who have the same view and scene agree about it.
    ///
    /// # Errors
    /// [`Error::Option`] as [`Tracer::render`].
    pub fn blocks(&self, scene: &Scene) -> Result<PictureBlocks> {
        let Frame { size, samples, crop, .. } = self.over(&scene.picture)?;
        Ok(PictureBlocks::new(size, samples, crop))
    }
}

impl Tracer {
    /// Renders some blocks of the picture that `view` asks for ([`View::blocks`]), by their numbers. Returns the pixels
    /// of each, linear radiance, in the order of [`PictureBlocks::places`]: those of the whole picture, to the bit,
    /// whatever other blocks are rendered, and by whom.
    ///
    /// ```
    /// use raybrook::{Scene, Tracer, View};
    ///
    /// let scene = Scene::from_mesh(&[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let view = View::new(64, 48).samples(1);
    /// let blocks = view.blocks(&scene)?;
    /// let mut tracer = Tracer::builder(&scene).device("reference").build()?;
    /// let pixels = tracer.render_blocks(&view, &blocks.numbers())?;
    /// assert_eq!(pixels.concat(), tracer.render(&view)?.pixels());
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Tracer::render`]; [`Error::Option`], too, when there is no block of such a number, and when the view asks
    /// for layers.
    pub fn render_blocks(&mut self, view: &View, numbers: &[usize]) -> Result<Vec<Vec<[f32; 3]>>> {
        let frame = view.over(&self.defaults)?;
        let Frame { size, samples, depth, crop, .. } = frame;
        if !frame.layers.is_empty() {
            return Err(Error::option("layers", "blocks have none; render the whole picture, or a part by its crop"));
        }
        let blocks = PictureBlocks::new(size, samples, crop);
        if let Some(missing) = numbers.iter().find(|&&number| !blocks.has(number)) {
            return Err(Error::option("blocks", format!("the picture has no block {missing}")));
        }
        let mut wanted = numbers.to_vec();
        wanted.sort_unstable();
        wanted.dedup();
        let camera = self.aim(&frame)?;
        let kept = wanted.iter().map(|&number| blocks.pixels(number) as u64).sum::<u64>() * Film::PIXEL_BYTES;
        self.check_blocks((size, crop), samples, kept)?;
        let picture = renderer::Picture { camera, size, samples, depth, kill_weight: None };
        let found: Vec<Mutex<Vec<_>>> = wanted.iter().map(|_| Mutex::default()).collect();
        let take = |finished: &Finished| {
            for &number in finished.blocks {
                let place = wanted.binary_search(&number).expect("only blocks that were asked for are told of");
                *lock(&found[place]) = blocks.gather(number, &finished.film).into_owned();
            }
            Ok(())
        };
        match self.team.is_several() {
            true => self.render_together((&picture, &blocks), &wanted, &take)?,
            false => {
                let buffers = self.buffers.clone();
                self.timed(depth, |backend, progress| {
                    render_blocks(backend, &buffers, &picture, &blocks, (&wanted[..], None), &mut &take, progress)
                })?;
            }
        }
        let found: Vec<_> = found.into_iter().map(unlocked).collect();
        let in_order = |number: &usize| found[wanted.partition_point(|other| other < number)].clone();
        Ok(if wanted == numbers { found } else { numbers.iter().map(in_order).collect() })
    }
}
