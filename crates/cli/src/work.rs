//! Counted work on the command line: what is printed of it, and the false-colour pictures of `raybrook render --aov`.

use super::Talk;
use super::files::Files;
use raybrook::Result;
use raybrook::low_level::aov::{Aov, AovRange};
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::shared::WorkCounter;
use raybrook::low_level::stats::WorkStats;
use raybrook::low_level::work::{PixelWork, WorkSum};
use std::path::{Path, PathBuf};

/// `out.png` and a name to `out-name.png`, or another ending.
pub fn beside(output: &Path, name: &str, ending: &str) -> PathBuf {
    let mut stem = output.file_stem().unwrap_or_default().to_owned();
    stem.push(format!("-{name}.{ending}"));
    output.with_file_name(stem)
}

/// The files of one counter: its picture, and beside a linear picture its numbers in the same format.
fn aov_paths(output: &Path, format: ImageFormat, counter: WorkCounter) -> (PathBuf, Option<PathBuf>) {
    let numbers = match format {
        ImageFormat::Exr => Some("exr"),
        ImageFormat::Pfm => Some("pfm"),
        _ => None,
    };
    (beside(output, counter.name(), "png"), numbers.map(|ending| beside(output, counter.name(), ending)))
}

/// The files of all `counters`.
pub fn aov_files(output: &Path, format: ImageFormat, counters: &[WorkCounter]) -> Vec<PathBuf> {
    let of_counter = |&counter: &WorkCounter| {
        let (colours, numbers) = aov_paths(output, format, counter);
        [Some(colours), numbers].into_iter().flatten()
    };
    counters.iter().flat_map(of_counter).collect()
}

/// Keeps that `option` has these files written.
pub fn claim_aovs(
    output: &Path,
    format: ImageFormat,
    counters: &[WorkCounter],
    option: &str,
    files: &mut Files,
) -> Result<()> {
    aov_files(output, format, counters).iter().try_for_each(|path| files.write(path, option))
}

/// Writes the pictures of `counters` beside `output` and returns what their colours mean.
pub fn write_aovs(
    output: &Path,
    format: ImageFormat,
    counters: &[WorkCounter],
    work: &[PixelWork],
    size: (u32, u32),
) -> Result<Vec<AovRange>> {
    let write = |&counter: &WorkCounter| {
        let aov = Aov::new(work, size, counter);
        let (colours, numbers) = aov_paths(output, format, counter);
        aov.false_colours().write(colours, None)?;
        if let Some(numbers) = numbers {
            aov.numbers().write(numbers, None)?;
        }
        Ok(aov.range())
    };
    counters.iter().map(write).collect()
}

/// Says what the colours mean.
pub fn say_ranges(output: &Path, ranges: &[AovRange]) {
    for range in ranges {
        let path = beside(output, range.counter.name(), "png");
        let AovRange { counter, brightest, maximum } = range;
        say!("{}: {counter} of a pixel from 0 (black) to {brightest} (brightest); at most {maximum}", path.display());
    }
}

/// Says what was counted, on average.
pub fn say_work(stats: &WorkStats, talk: Talk) {
    if stats.all.saturated > 0 {
        tell!(
            "warning: {} counts outgrew 32 bits, sums and means are too small; take fewer samples a pixel",
            stats.all.saturated
        );
    }
    if talk.quiet {
        return;
    }
    let line = |what: &str, sum: &WorkSum| {
        let mean = |counter| sum.mean(counter);
        say!(
            "{what}: {:.2} steps, {:.2} leaves ({:.2} empty), {:.2} tests ({:.4} extended, {:.4} close), {:.2} \
             restarts, {:.2} overflows, {:.0} bytes of nodes, {:.0} of triangles a ray; deepest stack {}",
            mean(WorkCounter::Steps),
            mean(WorkCounter::Leaves),
            mean(WorkCounter::EmptyLeaves),
            mean(WorkCounter::Tests),
            mean(WorkCounter::ExtendedTests),
            mean(WorkCounter::CloseTests),
            mean(WorkCounter::Restarts),
            mean(WorkCounter::Overflows),
            mean(WorkCounter::NodeBytes),
            mean(WorkCounter::TriangleBytes),
            sum.get(WorkCounter::DeepestStack)
        );
    };
    line("camera rays", &stats.camera);
    if stats.all.rays > stats.camera.rays {
        line("all rays", &stats.all);
    }
}
