//! Pictures on their way are kept beside their output, in `OUT.partial`: what stops the program costs no more than the
//! last seconds, and the same command goes on.

use super::display::Display;
use super::limit::Limit;
use super::log::Log;
use super::loss::{LossArgs, Watching};
use super::open::Opened;
use super::progress::Bar;
use super::{Talk, heading};
use clap::ValueEnum;
use raybrook::low_level::film::Film;
use raybrook::low_level::journal;
use raybrook::low_level::options::Decisions;
use raybrook::low_level::renderer::{
    KeptBlock, Part, Picture, PictureBlocks, PictureId, PictureJournal, RowsInOrder, is_large, read_kept,
    render_blocks, render_by_several,
};
use raybrook::low_level::rows::PutRows;
use raybrook::low_level::scene::Samples;
use raybrook::low_level::several::Devices;
use raybrook::low_level::tracer::{DeviceShare, Finished, LostDevice, RenderResult, Spent};
use raybrook::{Error, Result};
use std::borrow::Cow;
use std::ffi::OsString;
use std::ops::Range;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

/// What takes less time is not kept.
const FROM: Duration = Duration::from_secs(2);

/// Whether what is finished is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Keep {
    /// What takes more than two seconds.
    Auto,
    /// From the first block of a picture on, or the first run of rays.
    Always,
    /// Nothing is kept, and nothing that was kept is read.
    Never,
}

#[derive(Clone, Copy, clap::Args)]
pub struct KeepArgs {
    /// Keep what is finished in OUT.partial, so that the same command goes on after whatever stopped it: auto, always
    /// or never [default: auto].
    ///
    /// auto: where a picture or a batch of rays takes more than two seconds. The file is removed when the output is
    /// written. Where work is counted, rays are traced again and again for timing, or --layers tells of samples or
    /// their error, nothing is kept. A picture of more than 44 million pixels by its --error is kept from the first
    /// block on, in place of memory.
    #[arg(long, help_heading = heading::OUTPUT, hide_short_help = true, value_name = "WHEN")]
    #[arg(default_value = "auto", hide_default_value = true, hide_possible_values = true)]
    pub keep: Keep,
    /// Begin anew, and remove what is kept of an earlier run.
    #[arg(long, help_heading = heading::OUTPUT, hide_short_help = true)]
    restart: bool,
}

/// Where the pixels of finished blocks go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Canvas {
    /// Onto a film, which is the result.
    Film,
    /// To whoever takes rows, in their order: bands are finished in it.
    Rows,
    /// Into the journal, which is the result of a part, and from which the rows of a picture come when it is complete.
    Journal,
}

impl KeepArgs {
    /// Where the pixels of a picture go of which so much is written. A large one is not kept in memory if there is
    /// another place for it.
    pub fn canvas(&self, size: (u32, u32), samples: Samples) -> Canvas {
        match (matches!(samples, Samples::Error(_)), is_large(size)) {
            (false, _) => Canvas::Rows,
            (true, true) if self.keep != Keep::Never => Canvas::Journal,
            _ => Canvas::Film,
        }
    }

    /// What is kept of the work on this output, or on a part of it, and where; what an earlier run has kept there is
    /// removed, if that is asked for. Beside a pipe or a device, such as /dev/stdout, nothing is kept unless it is
    /// asked for, or the journal `is_result`. Where the time may be up, everything that is finished is kept.
    ///
    /// # Errors
    /// [`Error::Option`] when nothing is to be kept where the time may be up; and as [`journal::remove_unbegun`].
    pub fn begin(
        self,
        limit: Limit,
        (output, part): (&Path, Option<Part>),
        is_result: bool,
    ) -> Result<(KeepArgs, PathBuf)> {
        let (args, path) = (if is_result { self } else { self.beside(output) }, journal_of(output, part));
        if self.restart && journal::is_journal(&path) {
            std::fs::remove_file(&path).map_err(|error| Error::io("remove", &path, error))?;
        }
        let args = args.within(limit)?;
        if args.keep != Keep::Never || self.restart {
            // Of a run that ended before anything was finished.
            journal::remove_unbegun(&path)?;
        }
        Ok((args, path))
    }

    /// The option, if there is one, by which something is said.
    pub fn is_given(&self) -> Option<&'static str> {
        let options = [(self.restart, "--restart"), (self.keep != Keep::Auto, "--keep")];
        options.into_iter().find_map(|(is_given, option)| is_given.then_some(option))
    }

    /// Keeps nothing.
    pub fn nothing() -> KeepArgs {
        KeepArgs { keep: Keep::Never, restart: false }
    }

    fn beside(self, output: &Path) -> KeepArgs {
        let is_no_file = output.metadata().is_ok_and(|found| !found.is_file());
        if self.keep == Keep::Auto && is_no_file { KeepArgs { keep: Keep::Never, ..self } } else { self }
    }

    fn within(self, limit: Limit) -> Result<KeepArgs> {
        match self.keep {
            Keep::Never if limit.is_set() => {
                let message = format!("with never, what is finished when {} is met would be lost", limit.option());
                Err(Error::option("--keep", message))
            }
            Keep::Auto if limit.is_set() => Ok(KeepArgs { keep: Keep::Always, ..self }),
            _ => Ok(self),
        }
    }

    /// Whether there is anything at `path` to go on with; a link to nowhere is something, too.
    pub fn goes_on(&self, path: &Path) -> bool {
        self.keep != Keep::Never && path.symlink_metadata().is_ok()
    }
}

impl Keep {
    /// Whether work that began at `start`, of which so much is done, takes so long that it is kept.
    pub fn is_worth_it(self, start: Instant, done: usize, of: usize) -> bool {
        let whole = start.elapsed().mul_f64(of as f64 / done.max(1) as f64);
        self == Keep::Auto && done < of && whole >= FROM
    }
}

/// The name of the journal of an output, or of a part of the work on it.
pub fn journal_of(output: &Path, part: Option<Part>) -> PathBuf {
    let ending = part.map_or("partial".to_owned(), |part| format!("part-{}-of-{}", part.number, part.of));
    let mut name = OsString::from(output);
    name.push(format!(".{ending}"));
    PathBuf::from(name)
}

/// Refuses to write an output of `option` over a journal.
///
/// # Errors
/// [`Error::Option`].
pub fn refuse_journal(output: Option<&Path>, option: &'static str) -> Result<()> {
    let Some(output) = output.filter(|output| journal::is_journal(output)) else { return Ok(()) };
    let message = format!("'{}' is a journal, which would be lost; choose another name", output.display());
    Err(Error::option(option, message))
}

/// What a picture is, found out where it is needed: hashing a large scene takes a while.
pub type LazyId<'a> = LazyLock<PictureId, Box<dyn FnOnce() -> PictureId + Send + 'a>>;

/// Keeps the blocks of a picture, or of a part of the work on it.
pub struct Keeper<'a> {
    log: Log<PictureJournal, Painted>,
    path: PathBuf,
    id: LazyId<'a>,
    part: Option<Part>,
    keep: Keep,
    limit: Limit,
    blocks: PictureBlocks,
    /// What is to be rendered, and how many blocks there are with those of earlier runs.
    rest: Vec<usize>,
    of: usize,
    start: Instant,
    display: Option<Display>,
    /// What earlier runs of the program took for the blocks that they kept.
    earlier: Spent,
}

/// What there is of a picture beside its journal.
struct Painted {
    spent: Spent,
    /// The picture, with the blocks of earlier runs until others are rendered.
    film: Option<Film>,
}

impl<'a> Keeper<'a> {
    /// Opens what is kept of the picture, or of a part of the work on it, if anything is.
    ///
    /// # Errors
    /// What is kept is of another picture, or cannot be read; or it cannot be removed where that is asked for.
    pub fn open(
        (args, limit): (&KeepArgs, Limit),
        (output, part): (&Path, Option<Part>),
        (id, blocks, canvas): (LazyId<'a>, PictureBlocks, Canvas),
        (display, talk): (Option<Display>, Talk),
    ) -> Result<Keeper<'a>> {
        let (args, path) = args.begin(limit, (output, part), canvas == Canvas::Journal)?;
        let rest = part.map_or_else(|| blocks.numbers(), |part| part.blocks(&blocks));
        let film = (canvas == Canvas::Film).then(|| blocks.empty_film());
        let (of, start, earlier) = (rest.len(), Instant::now(), Spent::default());
        let log = Log::new(of, "blocks", Painted { spent: Spent::default(), film });
        let mut keeper =
            Keeper { log, path, id, part, keep: args.keep, limit, blocks, rest, of, start, display, earlier };
        if args.goes_on(&keeper.path) {
            keeper.go_on(talk).map_err(|error| to_begin_anew(error, &keeper.path))?;
        } else if canvas == Canvas::Journal || args.keep == Keep::Always {
            keeper.log.lock().journal = Some(keeper.new_journal()?);
        }
        keeper.log.watch(talk);
        Ok(keeper)
    }

    fn new_journal(&self) -> Result<PictureJournal> {
        PictureJournal::create(&self.path, &self.id, self.part, &self.blocks)
    }

    /// Takes what an earlier run has kept.
    fn go_on(&mut self, talk: Talk) -> Result<()> {
        let mut done = self.log.lock();
        let (film, display) = (&mut done.more.film, &self.display);
        let mut take = |blocks: &PictureBlocks, block: &KeptBlock| {
            display.iter().for_each(|display| display.show_kept(blocks, block.number, block.pixels));
            film.as_mut().map_or(Ok(()), |film| blocks.scatter(block.number, block.pixels, film))
        };
        let (journal, kept) = PictureJournal::open(&self.path, &self.id, self.part, &self.blocks, &mut take)?;
        self.rest.retain(|number| kept.blocks.binary_search(number).is_err());
        (done.more.spent, self.earlier) = (kept.spent, kept.spent);
        done.go_on(journal, self.rest.len(), kept.condition.damaged_bytes, talk);
        Ok(())
    }

    /// Takes note of blocks that are finished. Returns whether they are kept.
    fn take(&self, finished: &Finished) -> Result<bool> {
        self.display.iter().for_each(|display| display.show(&self.blocks, finished));
        let mut done = self.log.lock();
        done.more.spent.add(&finished.spent);
        // Of several devices; a single one has the film.
        if let Some(film) = &mut done.more.film {
            self.blocks.copy(finished, film)?;
        }
        let is_worth_it = |done, of| self.keep.is_worth_it(self.start, done, of);
        done.take(finished.blocks.len(), is_worth_it, || self.new_journal(), |journal| journal.append(finished))?;
        Ok(done.journal.is_some())
    }

    /// Renders the blocks that are not kept yet. The result is of all, with those of earlier runs; its film has no
    /// pixels where `rows` takes them.
    ///
    /// # Errors
    /// As [`render_blocks`], where the journal cannot be made, written or read, and those of `rows`.
    pub fn render(
        &mut self,
        opened: &mut Opened,
        picture: &Picture,
        rows: Option<PutRows>,
        talk: Talk,
    ) -> Result<RenderResult> {
        let bar = Bar::new("render", talk);
        let rays = self.rays(picture);
        let progress = |done: f64| {
            self.limit.check();
            bar.update(done, rays, "M camera rays");
        };
        self.start = Instant::now();
        let film = self.log.lock().more.film.take();
        let mut rows = rows.map(|put| RowsInOrder::new(&self.blocks, &self.rest, put));
        let mut take = |finished: &Finished| {
            let is_kept = self.take(finished)?;
            let Some(rows) = rows.as_mut().filter(|_| self.blocks.are_bands()) else { return Ok(()) };
            let kept = |rows: &Range<usize>, put: PutRows| self.put_kept(rows, put);
            finished
                .blocks
                .iter()
                .try_for_each(|&number| rows.take(number, self.blocks.gather(number, &finished.film), is_kept, &kept))
        };
        let (tracer, rest) = (opened.tracer.as_mut(), (&self.rest[..], film));
        let result = render_blocks(tracer, &opened.buffers, picture, &self.blocks, rest, &mut take, &progress)?;
        drop(bar);
        rows.map_or(Ok(()), |rows| rows.finish(&|rows, put| self.put_rest(rows, put, talk)))?;
        Ok(self.with_all(result))
    }

    /// Hands on rows from the journal, where there is one; without it they were handed on when they were finished.
    fn put_kept(&self, rows: &Range<usize>, put: PutRows) -> Result<()> {
        // Whoever stops the program must not wait for the rows.
        let kept = self.log.lock().journal.as_ref().map(PictureJournal::rows);
        kept.map_or(Ok(()), |kept| kept.put(rows, put))
    }

    /// The same of what nothing is rendered for any more.
    fn put_rest(&self, rows: &Range<usize>, put: PutRows, talk: Talk) -> Result<()> {
        let bar = Bar::new("write", talk);
        let (mut done, all) = (0, rows.len() as f64 * f64::from(self.blocks.size().0));
        let mut put = |rows: &[[f32; 3]]| {
            put(rows)?;
            done += rows.len();
            bar.update(done as f64 / all, all / 1e6, "M pixels");
            Ok(())
        };
        self.put_kept(rows, &mut put)
    }

    /// Hands on all rows, which are kept.
    ///
    /// # Errors
    /// The journal cannot be read, and those of `put`.
    pub fn put_all(&self, put: PutRows, talk: Talk) -> Result<()> {
        self.put_rest(&(0..self.blocks.size().1 as usize), put, talk)
    }

    /// As [`Keeper::render`], by several devices; tells, too, what each did, and which failed.
    ///
    /// # Errors
    /// As [`render_by_several`], and where the journal cannot be made or written; and those of `rows`.
    pub fn render_by(
        &mut self,
        devices: Devices,
        (picture, rows): (&Picture, Option<PutRows>),
        (loss, talk): (LossArgs, Talk),
    ) -> Result<(RenderResult, Vec<DeviceShare>, Vec<LostDevice>)> {
        self.start = Instant::now();
        let work = (self.rays(picture), "M camera rays");
        let watching = Watching::new(Bar::new("render", talk), work, (loss, self.limit), talk);
        let this = &*self;
        let wanted = (&this.blocks, &this.rest[..]);
        let render = |send: &(dyn Fn(&Finished, bool) -> Result<()> + Sync)| {
            let take = |finished: &Finished| send(finished, this.take(finished)?);
            render_by_several(devices, picture, wanted, &take, &watching)
        };
        let (shares, taking_s) = match rows {
            Some(put) if wanted.0.are_bands() => {
                let (shares, taking_s) = this.put_bands(put, render)?;
                (shares, Some(taking_s))
            }
            Some(put) => {
                let shares = render(&|_, _| Ok(()))?;
                this.put_all(put, talk)?;
                (shares, None)
            }
            None => (render(&|_, _| Ok(()))?, None),
        };
        let film = self.log.lock().more.film.take().unwrap_or_else(|| self.blocks.empty_film());
        let result = self.with_all(RenderResult { taking_s, ..RenderResult::of_film(film) });
        Ok((result, shares, watching.into_lost()))
    }

    /// Hands on the rows of bands that several devices finish, while they trace others. Returns, too, for how many
    /// seconds that went on when all were finished.
    fn put_bands<T: Send>(
        &self,
        put: PutRows,
        render: impl FnOnce(&(dyn Fn(&Finished, bool) -> Result<()> + Sync)) -> Result<T> + Send,
    ) -> Result<(T, f64)> {
        let kept = |rows: &Range<usize>, put: PutRows| self.put_kept(rows, put);
        let mut rows = RowsInOrder::new(&self.blocks, &self.rest, put);
        let mut written = Ok(());
        let rendered = std::thread::scope(|scope| {
            let (sender, receiver) = sync_channel(1);
            let send = move |finished: &Finished, is_kept: bool| {
                let pixels = |number| Cow::Owned(self.blocks.gather(number, &finished.film).into_owned());
                let bands = finished.blocks.iter().map(|&number| (number, pixels(number), is_kept));
                // Nobody takes them any more where rows cannot be written.
                sender.send(bands.collect::<Vec<_>>()).map_err(|_| Error::Stopped)
            };
            let rendering = scope.spawn(move || Ok((render(&send)?, Instant::now())));
            let mut bands = receiver.into_iter().flatten();
            written = bands.try_for_each(|(number, pixels, is_kept)| rows.take(number, pixels, is_kept, &kept));
            drop(bands);
            rendering.join().unwrap_or_else(|panic| resume_unwind(panic))
        });
        written?;
        let (rendered, end) = rendered?;
        rows.finish(&kept)?;
        Ok((rendered, end.elapsed().as_secs_f64()))
    }

    /// What earlier runs of the program took, which is in the results of [`Keeper::render`].
    pub fn earlier(&self) -> Spent {
        self.earlier
    }

    /// About how many millions of camera rays are at least to be traced.
    fn rays(&self, picture: &Picture) -> f64 {
        let Film { width, height, .. } = self.blocks.empty_film();
        let part = self.rest.len() as f64 / self.blocks.numbers().len().max(1) as f64;
        part * f64::from(width) * f64::from(height) * f64::from(picture.samples.per_pixel()) / 1e6
    }

    /// A result with what the blocks of earlier runs took.
    fn with_all(&self, result: RenderResult) -> RenderResult {
        let spent = self.log.lock().more.spent;
        let decided_by = result.adaptive.map_or(Decisions::Host, |adaptive| adaptive.decided_by);
        let adaptive = self.blocks.adaptive_stats(&spent, decided_by);
        let Spent { counts, second_pass, kernel_s, read_s, .. } = spent;
        let film = if result.film.pixels.is_empty() { self.blocks.empty_film() } else { result.film };
        RenderResult { film, counts, second_pass, kernel_s, read_s, adaptive, ..result }
    }

    /// Whether something is left to be rendered.
    pub fn has_rest(&self) -> bool {
        !self.rest.is_empty()
    }

    /// Puts the blocks that are kept onto a film of the whole picture, and tells how many of how many these are.
    ///
    /// # Errors
    /// As [`read_kept`].
    pub fn put_so_far(&self, film: &mut Film) -> Result<(usize, usize)> {
        let mut put = |blocks: &PictureBlocks, block: &KeptBlock| blocks.scatter(block.number, block.pixels, film);
        let kept = read_kept(&self.path, Some(&self.id), &mut put)?;
        Ok((kept.blocks.len(), self.of))
    }

    /// Ends keeping: the picture is written.
    ///
    /// # Errors
    /// The journal cannot be removed.
    pub fn finish(self) -> Result<()> {
        self.log.end().map_or(Ok(()), PictureJournal::remove)
    }

    /// Ends keeping a part of the work, of which the journal is the result.
    ///
    /// # Errors
    /// The journal cannot be brought to the disk.
    pub fn finish_part(self, part: Part, talk: Talk) -> Result<()> {
        self.log.end_part(&self.path, part, self.start, talk)
    }
}

/// Says, too, how to do without what is kept.
pub fn to_begin_anew(error: Error, path: &Path) -> Error {
    match error {
        Error::Input { path: input, line, message } if journal::is_journal(path) => {
            let message = format!("{message}; --restart begins anew, --keep never leaves it alone");
            Error::Input { path: input, line, message }
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_pictures_are_not_kept_in_memory_where_there_is_another_place() {
        let canvas = |keep, size, samples| KeepArgs { keep, restart: false }.canvas(size, samples);
        let (large, small) = ((65535, 65535), (7680, 4320));
        let (fixed, by_error) = (Samples::PerPixel(1), Samples::Error(1.0));
        for keep in [Keep::Auto, Keep::Always, Keep::Never] {
            assert_eq!(canvas(keep, small, fixed), Canvas::Rows);
            assert_eq!(canvas(keep, small, by_error), Canvas::Film);
            assert_eq!(canvas(keep, large, fixed), Canvas::Rows);
            let kept = if keep == Keep::Never { Canvas::Film } else { Canvas::Journal };
            assert_eq!(canvas(keep, large, by_error), kept);
        }
    }
}
