//! Pictures of bounded error whose pixels the device keeps: between lists of rays the host reads how many pixels
//! promise how much and how many of each tile are chosen, and says where the tiles' parts of the list begin. The
//! kernels are in `cl/kernels/adaptive.cl`; what they do and why, and the host's way to the same bits, is in
//! [`crate::adaptive`].

use super::launch::Arguments;
use super::passes::Passes;
use super::picture::{Launches, PictureBuffers, RenderLists};
use super::{Buffer, CompileOptions, DeviceContext, Event, Kernel, Program, ProgramSource};
use crate::adaptive::{COUNTED, CURVE, Choice, Pixels, Promises, cl_constants, refine, sample_sequence};
use crate::blocks::Blocks;
use crate::error::Result;
use crate::io::film::Film;
use crate::layout::Float4;
use crate::shared::{CameraSample, RenderParams, TILE_PIXELS, TILE_SIDE};
use crate::tracer::{Adaptive, MOST_SAMPLES, Progress, RenderResult, Spent};
use std::ops::Range;
use std::time::Instant;

/// In place of a class: the pixels of the lattice are asked for.
const LATTICE: u32 = 0;
/// Parts of the sum of a block's squared errors, so that work-items seldom meet at one.
const SUM_SLOTS: usize = 32;

/// What no picture changes.
pub(super) struct AdaptiveProgram {
    program: Program,
    sequence: Buffer<CameraSample>,
    curve: Buffer<f32>,
}

impl AdaptiveProgram {
    pub fn new(context: &DeviceContext, passes: &mut Passes) -> Result<Self> {
        let source = ProgramSource::adaptive(&cl_constants());
        let options = CompileOptions::new().define("SUM_SLOTS", format!("{SUM_SLOTS}u")).define("LATTICE", LATTICE);
        Ok(AdaptiveProgram {
            program: passes.build(context, &source, &options)?,
            sequence: Buffer::from_slice(context, "sample sequence", &sample_sequence())?,
            curve: Buffer::from_slice(context, "screen's curve", &CURVE)?,
        })
    }
}

/// The kernels of one picture: they would keep its arrays.
struct AdaptiveKernels {
    forget: Kernel,
    count: Kernel,
    list: Kernel,
    place: Kernel,
    take: Kernel,
    tell: Kernel,
    interpolate: Kernel,
    cells: Kernel,
    update: Kernel,
    show: Kernel,
}

impl AdaptiveKernels {
    fn new(program: &Program) -> Result<Self> {
        Ok(AdaptiveKernels {
            forget: program.kernel("forget_pixels")?,
            count: program.kernel("count_wanted")?,
            list: program.kernel("list_wanted")?,
            place: program.kernel("place_samples")?,
            take: program.kernel("take_samples")?,
            tell: program.kernel("tell_neighbours")?,
            interpolate: program.kernel("interpolate")?,
            cells: program.kernel("estimate_cells")?,
            update: program.kernel("update_estimates")?,
            show: program.kernel("show_means")?,
        })
    }
}

/// What is known of the pixels: `PIXEL_ARGUMENTS` of the kernels.
struct PixelArrays {
    size: (usize, usize),
    lattice: usize,
    blocks: Blocks,
    film: Buffer<Float4>,
    sums: Buffer<Float4>,
    shown: Buffer<Float4>,
    states: Buffer<u32>,
    errors: Buffer<f32>,
    classes: Buffer<u32>,
}

impl PixelArrays {
    fn new(context: &DeviceContext, size: (usize, usize), lattice: usize, blocks: Blocks) -> Result<Self> {
        let count = size.0 * size.1;
        Ok(PixelArrays {
            size,
            lattice,
            blocks,
            film: Buffer::empty(context, "picture", count)?,
            sums: Buffer::empty(context, "sums of samples", count)?,
            shown: Buffer::empty(context, "estimates", count)?,
            states: Buffer::empty(context, "levels", count)?,
            errors: Buffer::empty(context, "errors", count)?,
            classes: Buffer::empty(context, "classes", count)?,
        })
    }

    fn count(&self) -> usize {
        self.size.0 * self.size.1
    }

    fn tiles(&self) -> usize {
        let side = TILE_SIDE as usize;
        self.size.0.div_ceil(side) * self.size.1.div_ceil(side)
    }

    /// Sets the arguments with which every kernel begins.
    fn arguments<'k>(&self, kernel: &'k mut Kernel) -> Result<Arguments<'k>> {
        let Blocks { patch_side, area, per_area, stride, .. } = self.blocks;
        let grid = [self.size.0, self.size.1, self.lattice, patch_side, area.0, area.1, per_area, stride];
        let arguments = grid.into_iter().try_fold(Arguments::of(kernel), |of, number| of.set(number as u32))?;
        arguments
            .set(&self.film)?
            .set(&self.sums)?
            .set(&self.shown)?
            .set(&self.states)?
            .set(&self.errors)?
            .set(&self.classes)
    }
}

/// Kernels that nobody has waited for.
struct Started {
    events: Vec<Event>,
    work_group: usize,
}

impl Started {
    /// Starts a kernel for `items`, its last two arguments being the first of them and their end.
    fn launch(&mut self, kernel: &mut Kernel, items: Range<usize>) -> Result<()> {
        let bounds = kernel.arg_count() - 2;
        kernel.set_arg(bounds, items.start as u32)?;
        kernel.set_arg(bounds + 1, items.end as u32)?;
        let work_items = items.len().next_multiple_of(self.work_group);
        self.events.push(kernel.launch(&[work_items], Some(&[self.work_group]))?);
        Ok(())
    }

    /// Waits for them. Their seconds.
    fn wait(&mut self) -> Result<f64> {
        self.events.drain(..).map(|event| event.wait()).sum()
    }
}

/// A picture, or an area of one, on its way whose pixels the device keeps.
pub(super) struct DevicePixels<'a> {
    tracer: &'a mut dyn RenderLists,
    program: &'a AdaptiveProgram,
    kernels: AdaptiveKernels,
    params: RenderParams,
    pixels: PixelArrays,
    /// Squared errors of the interpolation, by cell of the lattice.
    cells: Buffer<f32>,
    /// Of each tile how many pixels are asked for, and how many samples; then how many there are in the tiles before.
    tiles: Buffer<[u32; 2]>,
    /// Of each block [`Promises`] and parts of the sum, as the kernel has them.
    of_blocks: Buffer<u32>,
    /// The same, fetched.
    promises: Vec<Promises>,
    /// Of each block which of its pixels are asked for.
    choices: Buffer<[u32; 2]>,
    /// Pixels of a list, and where the samples of each begin.
    list: Buffer<[u32; 2]>,
    /// How much those are wrong that were interpolated.
    changes: Buffer<f32>,
    rays: PictureBuffers,
    launches: Launches,
    started: Started,
    /// The most rays of a list of more than one tile.
    most_rays: u64,
    round: u32,
    result: RenderResult,
    decide_s: f64,
}

impl<'a> DevicePixels<'a> {
    /// Room for a picture, and what decides of its pixels.
    ///
    /// # Errors
    /// The device cannot hold it.
    pub fn new(
        tracer: &'a mut dyn RenderLists,
        program: &'a AdaptiveProgram,
        params: &RenderParams,
        (adaptive, blocks): (Adaptive, Blocks),
    ) -> Result<Self> {
        let context = &tracer.context().clone();
        let size = (params.width as usize, params.height as usize);
        let pixels = PixelArrays::new(context, size, adaptive.step(), blocks)?;
        let areas = blocks.areas();
        let on_axis = |pixels: usize| (pixels - 1) / adaptive.step() + 1;
        let cells = if adaptive.step() > 1 { areas * on_axis(blocks.area.0) * on_axis(blocks.area.1) } else { 0 };
        let count = areas * blocks.per_area;
        // A tile is not divided between lists.
        let tile_rays = (TILE_PIXELS * MOST_SAMPLES) as usize;
        let most_rays = adaptive.list_rays.max(tile_rays).min(pixels.count().saturating_mul(MOST_SAMPLES as usize));
        let rays = PictureBuffers::of_lists(context, params, most_rays)?;
        let launches = tracer.launches(&params.of_list(most_rays as u32))?;
        let film = Film { width: params.width, height: params.height, pixels: Vec::new() };
        Ok(DevicePixels {
            kernels: AdaptiveKernels::new(&program.program)?,
            params: *params,
            cells: Buffer::empty(context, "cells of the lattice", cells)?,
            tiles: Buffer::empty(context, "tiles", pixels.tiles())?,
            of_blocks: Buffer::read_write(context, "promises", &vec![0; count * (COUNTED + 2 * SUM_SLOTS)])?,
            promises: vec![Promises::default(); count],
            choices: Buffer::read_write(context, "choices", &vec![[LATTICE, 0]; count])?,
            list: Buffer::empty(context, "listed pixels", pixels.count().min(most_rays))?,
            changes: Buffer::empty(context, "changes", pixels.count().min(most_rays))?,
            rays,
            launches,
            started: Started { events: Vec::new(), work_group: tracer.work_group() },
            most_rays: adaptive.list_rays as u64,
            round: 0,
            result: RenderResult::of_film(film),
            decide_s: 0.0,
            program,
            tracer,
            pixels,
        })
    }

    /// Renders it. What it took is told of the result, and with what became of its blocks.
    pub fn render(mut self, adaptive: Adaptive, progress: Progress) -> Result<(RenderResult, Spent)> {
        self.deciding(|this| {
            this.pixels.arguments(&mut this.kernels.forget)?;
            this.started.launch(&mut this.kernels.forget, 0..this.pixels.count())
        })?;
        let blocks = self.pixels.blocks;
        let refined = refine(&mut self, &blocks.pixels(), adaptive, progress)?;
        self.deciding(|this| {
            this.pixels.arguments(&mut this.kernels.show)?;
            this.started.launch(&mut this.kernels.show, 0..this.pixels.count())
        })?;
        let start = Instant::now();
        self.result.film.pixels = self.pixels.shown.as_of::<[f32; 3]>(self.pixels.count()).read()?;
        self.result.read_s = start.elapsed().as_secs_f64();
        let spent = Spent { refined, ..Spent::of(&self.result, self.decide_s) };
        Ok((self.result, spent))
    }

    /// Counts what deciding takes beside the kernels.
    fn deciding<T>(&mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let start = Instant::now();
        let done = work(self)?;
        let kernels_s = self.started.wait()?;
        self.result.kernel_s += kernels_s;
        self.decide_s += (start.elapsed().as_secs_f64() - kernels_s).max(0.0);
        Ok(done)
    }

    /// Counts the pixels of the choices, and puts them into lists: the tiles of each, the tiles before which its pixels
    /// and samples begin, and how many of both it has.
    fn divide(&mut self) -> Result<Vec<Part>> {
        let (tiles, kernel) = (self.pixels.tiles(), &mut self.kernels.count);
        self.pixels.arguments(kernel)?.set(&self.tiles)?.set(&self.choices)?;
        self.started.launch(kernel, 0..tiles)?;
        let mut counts = self.tiles.read()?;
        let parts = divide(&mut counts, self.most_rays);
        self.tiles.write(&counts)?;
        Ok(parts)
    }

    /// Takes the new samples of the pixels that are asked for. Returns how many pixels that are.
    fn take(&mut self) -> Result<u64> {
        self.round += 1;
        let parts = self.deciding(Self::divide)?;
        parts.iter().try_for_each(|part| self.trace(part))?;
        Ok(parts.iter().map(|part| u64::from(part.count[0])).sum())
    }

    /// Traces the new samples of a part of the choices.
    fn trace(&mut self, part: &Part) -> Result<()> {
        self.deciding(|this| {
            let (pixels, kernels) = (&this.pixels, &mut this.kernels);
            let arguments = pixels.arguments(&mut kernels.list)?.set(&this.tiles)?.set(&this.choices)?;
            arguments.set(&this.list)?.set(part.before[0])?.set(part.before[1])?;
            this.started.launch(&mut kernels.list, part.tiles.clone())?;
            let arguments = pixels.arguments(&mut kernels.place)?.set(&this.list)?;
            let (left, top) = this.params.place();
            arguments.set(&this.program.sequence)?.set(&this.rays.samples)?.set(left)?.set(top)?;
            this.started.launch(&mut kernels.place, 0..part.count[0] as usize)?;
            this.rays.params.write(&[this.params.of_list(part.count[1])])
        })?;
        let params = self.params.of_list(part.count[1]);
        self.launches.begin_list();
        let rendered = self.tracer.render_list(&self.rays, &params, &mut self.launches)?;
        // The list's pixels stay where they are.
        self.result.add(&rendered.with_film(Film { width: 0, height: 0, pixels: Vec::new() }));
        self.deciding(|this| {
            let (pixels, kernels) = (&this.pixels, &mut this.kernels);
            let listed = 0..part.count[0] as usize;
            let arguments = pixels.arguments(&mut kernels.take)?.set(&this.list)?.set(&this.rays.film)?;
            arguments.set(&this.program.curve)?.set(&this.changes)?.set(this.round)?;
            this.started.launch(&mut kernels.take, listed.clone())?;
            if this.pixels.lattice > 1 && this.round > 1 {
                pixels.arguments(&mut kernels.tell)?.set(&this.list)?.set(&this.changes)?;
                this.started.launch(&mut kernels.tell, listed)?;
            }
            Ok(())
        })
    }
}

impl Pixels for DevicePixels<'_> {
    fn begin(&mut self) -> Result<u64> {
        let traced = self.take()?;
        if self.pixels.lattice > 1 {
            self.deciding(|this| {
                this.pixels.arguments(&mut this.kernels.interpolate)?.set(&this.program.curve)?;
                this.started.launch(&mut this.kernels.interpolate, 0..this.pixels.count())?;
                this.pixels.arguments(&mut this.kernels.cells)?.set(&this.cells)?;
                this.started.launch(&mut this.kernels.cells, 0..this.cells.len())
            })?;
        }
        Ok(traced)
    }

    fn raise(&mut self, choices: &[Choice]) -> Result<()> {
        let as_told = |choice: &Choice| [choice.lowest as u32, u32::from(choice.only_interpolated)];
        let choices: Vec<[u32; 2]> = choices.iter().map(as_told).collect();
        self.deciding(|this| this.choices.write(&choices))?;
        self.take().map(drop)
    }

    fn update(&mut self) -> Result<&[Promises]> {
        self.deciding(|this| {
            let kernel = &mut this.kernels.update;
            let arguments = this.pixels.arguments(kernel)?.set(&this.cells)?.set(&this.program.curve)?;
            arguments.set(&this.of_blocks)?.set(this.round)?;
            this.started.launch(kernel, 0..this.pixels.count())?;
            let fetched = this.of_blocks.read()?;
            for (promises, fetched) in this.promises.iter_mut().zip(fetched.chunks_exact(COUNTED + 2 * SUM_SLOTS)) {
                let (pixels, sums) = fetched.split_at(COUNTED);
                promises.pixels.copy_from_slice(pixels);
                let error = sums.chunks_exact(2).map(|sum| u64::from(sum[0]) | u64::from(sum[1]) << 32);
                promises.error = error.fold(0, u64::wrapping_add);
            }
            Ok(())
        })?;
        Ok(&self.promises)
    }
}

/// What is traced in one list.
#[derive(Debug, PartialEq)]
struct Part {
    tiles: Range<usize>,
    /// Pixels and samples of the tiles before.
    before: [u32; 2],
    /// Pixels and samples.
    count: [u32; 2],
}

/// Divides tiles into lists of at most so many rays, or of one tile. `tiles`, which are pixels and samples of each,
/// become those of all the tiles before in the same round, modulo 2^32.
fn divide(tiles: &mut [[u32; 2]], most_rays: u64) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let mut before = [0_u32; 2];
    for (number, tile) in tiles.iter_mut().enumerate() {
        let count = std::mem::replace(tile, before);
        if count[0] == 0 {
            continue;
        }
        match parts.last_mut() {
            Some(part) if u64::from(part.count[1]) + u64::from(count[1]) <= most_rays => {
                part.tiles.end = number + 1;
                part.count = [part.count[0] + count[0], part.count[1] + count[1]];
            }
            _ => parts.push(Part { tiles: number..number + 1, before, count }),
        }
        before = [before[0].wrapping_add(count[0]), before[1].wrapping_add(count[1])];
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_divided_into_lists_that_are_short_enough() {
        let mut tiles = [[0, 0], [3, 9], [1, 1], [0, 0], [2, 6], [64, 200], [5, 5], [0, 0]];
        let parts = divide(&mut tiles, 16);
        let part = |tiles, before, count| Part { tiles, before, count };
        let expected = [
            part(1..5, [0, 0], [6, 16]),
            part(5..6, [6, 16], [64, 200]), // longer than a list, but not divided
            part(6..7, [70, 216], [5, 5]),
        ];
        assert_eq!(parts, expected);
        assert_eq!(tiles, [[0, 0], [0, 0], [3, 9], [4, 10], [4, 10], [6, 16], [70, 216], [75, 221]]);
        assert_eq!(divide(&mut [[0, 0]; 4], 16), []);
        // Numbers of samples beyond 2^32 are those of the tiles before all the same.
        let many = u32::MAX - 9;
        let mut tiles = [[1, many], [1, 12], [1, 1]];
        assert_eq!(divide(&mut tiles, 16)[1], part(1..3, [1, many], [2, 13]));
        assert_eq!(tiles[2], [2, 2]);
    }
}
