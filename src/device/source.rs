//! Assembles the kernel files into one source, and finds the file and line behind a line of a build log.
//!
//! The files are concatenated, each behind `#line 1 "cl/…"`. PoCL's logs then name the file by themselves; NVIDIA's compiler
//! ignores the directive and counts through the whole source (`<kernel>:94:34`), as Oclgrind's does (`input.cl:94:34`): the host
//! maps such places back.

/// A table of kernel files: path from the crate root, text.
macro_rules! kernel_files {
    ($($path:literal),* $(,)?) => { &[$(($path, include_str!(concat!("../../", $path)))),*] };
}

/// The kernel files of every program, one path a line such as `"cl/shared/types.cl"`, in the order in which they are compiled: a file
/// uses only what stands above it.
pub const KERNEL_FILES: &[(&str, &str)] = kernel_files![
    "cl/shared/types.cl",
    "cl/shared/math.cl",
    "cl/shared/wide.cl",
    "cl/shared/double_double.cl",
    "cl/shared/integer.cl",
    "cl/shared/memory.cl",
    "cl/shared/ray.cl",
    "cl/intersect/moller_trumbore.cl",
    "cl/intersect/watertight.cl",
    "cl/intersect/exact_filter.cl",
    "cl/intersect/exact_closer.cl",
    "cl/intersect/exact_whole.cl",
    "cl/intersect/exact.cl",
    "cl/intersect/plucker.cl",
    "cl/intersect/precomputed.cl",
    "cl/intersect/thesis.cl",
    "cl/traverse/leaf.cl",
    "cl/traverse/brute_force.cl",
    "cl/traverse/kd_step.cl",
    "cl/traverse/kd_stack.cl",
    "cl/traverse/kd_restart.cl",
    "cl/traverse/kd_push_down.cl",
    "cl/traverse/kd_short_stack.cl",
    "cl/traverse/kd_ropes.cl",
    "cl/traverse/thesis_restart.cl",
    "cl/traverse/grid.cl",
    "cl/traverse/octree.cl",
    "cl/traverse/boxes.cl",
    "cl/traverse/spheres.cl",
    "cl/shade/normal.cl",
    "cl/shade/surface.cl",
    "cl/shade/procedural.cl",
    "cl/shade/texture.cl",
    "cl/shade/light.cl",
    "cl/shade/whitted.cl",
    "cl/shade/scene.cl",
    "cl/shade/local_light.cl",
    "cl/shade/camera.cl",
];

/// What comes behind them: entry points, of which a program has those that it needs. Nobody waits for the compilation of the others.
const ENTRY_FILES: &[(&str, &str)] =
    kernel_files!["cl/kernels/trace.cl", "cl/kernels/render.cl", "cl/kernels/split.cl"];

/// Before all files: correctly rounded results must not change where the compiler may fuse a product and a sum.
const FIRST_LINE: &str = "#pragma OPENCL FP_CONTRACT OFF\n";

/// How compilers that ignore `#line` (NVIDIA's, Oclgrind's) name the source in their logs; the line is then counted through the
/// whole source.
const WHOLE_SOURCE_NAMES: [&str; 3] = ["<kernel>", "<source>", "input.cl"];

/// The source of a program, and where its lines come from.
#[derive(Debug, Clone)]
pub struct ProgramSource {
    text: String,
    /// For each file: the line of `text`, counted from 1, that is its first one, and its path.
    starts: Vec<(usize, String)>,
}

impl ProgramSource {
    /// The kernels of `entry_files`, such as `"cl/kernels/trace.cl"`, and all that they need.
    pub fn kernels(entry_files: &[&str]) -> Self {
        let entries = ENTRY_FILES.iter().filter(|(path, _)| entry_files.contains(path));
        Self::new(KERNEL_FILES.iter().chain(entries).copied())
    }

    /// A program of the given files: path as logs shall name it, text.
    pub fn new<'a>(files: impl IntoIterator<Item = (&'a str, &'a str)>) -> Self {
        let mut source = ProgramSource { text: FIRST_LINE.to_owned(), starts: Vec::new() };
        for (path, text) in files {
            source.text += &format!("#line 1 \"{path}\"\n");
            source.starts.push((source.text.lines().count() + 1, path.to_owned()));
            source.text += text;
            if !text.ends_with('\n') {
                source.text.push('\n');
            }
        }
        source
    }

    /// What the compiler gets.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The file and its line behind line `line` of [`ProgramSource::text`], both counted from 1.
    pub fn locate(&self, line: usize) -> Option<(&str, usize)> {
        let after = self.starts.partition_point(|(start, _)| *start <= line);
        let (start, path) = self.starts.get(after.checked_sub(1)?)?;
        Some((path, line - start + 1))
    }

    /// A build log in which every place is named by file and line of that file.
    pub fn map_log(&self, log: &str) -> String {
        let lines: Vec<_> =
            log.lines().map(|line| self.map_log_line(line).unwrap_or_else(|| line.to_owned())).collect();
        lines.join("\n")
    }

    /// `<kernel>:94:34: error: …`, also behind other words, becomes `cl/shared/math.cl:12:34: error: …`.
    fn map_log_line(&self, line: &str) -> Option<String> {
        let (at, name) = WHOLE_SOURCE_NAMES.iter().find_map(|name| Some((line.find(&format!("{name}:"))?, *name)))?;
        // Not the end of a longer path.
        if line[..at].ends_with(|c: char| !c.is_whitespace()) {
            return None;
        }
        let rest = &line[at + name.len() + 1..];
        let digits = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
        let (path, file_line) = self.locate(rest[..digits].parse().ok()?)?;
        Some(format!("{}{path}:{file_line}{}", &line[..at], &rest[digits..]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of the whole: 1 pragma, 2 #line, 3-4 a.cl, 5 #line, 6 b.cl, 7 #line, 8 c.cl.
    fn three_files() -> ProgramSource {
        ProgramSource::new([("cl/a.cl", "int a1;\nint a2;\n"), ("cl/b.cl", "int b1;"), ("cl/c.cl", "int c1;\n")])
    }

    #[test]
    fn the_source_names_its_files_and_forbids_contraction() {
        let expected = "#pragma OPENCL FP_CONTRACT OFF\n#line 1 \"cl/a.cl\"\nint a1;\nint a2;\n#line 1 \"cl/b.cl\"\nint b1;\n\
                        #line 1 \"cl/c.cl\"\nint c1;\n";
        assert_eq!(three_files().text(), expected);
    }

    #[test]
    fn every_line_is_located() {
        let source = three_files();
        let places: Vec<_> = (1..=8).map(|line| source.locate(line)).collect();
        assert_eq!(places[..3], [None, None, Some(("cl/a.cl", 1))]);
        assert_eq!(places[3], Some(("cl/a.cl", 2)));
        assert_eq!(places[5], Some(("cl/b.cl", 1)));
        assert_eq!(places[7], Some(("cl/c.cl", 1)));
    }

    #[test]
    fn nvidia_places_are_mapped_and_others_kept() {
        let source = three_files();
        for (log, expected) in [
            ("<kernel>:4:34: error: expected ';'", "cl/a.cl:2:34: error: expected ';'"),
            ("<kernel>:6:1: warning: x\nint b1;\n^", "cl/b.cl:1:1: warning: x\nint b1;\n^"),
            ("In file: <kernel>:8:2: note: y", "In file: cl/c.cl:1:2: note: y"),
            ("input.cl:6:3: error: z", "cl/b.cl:1:3: error: z"),
            ("cl/input.cl:6:3: error: z", "cl/input.cl:6:3: error: z"),
            ("cl/a.cl:2:34: error: named already", "cl/a.cl:2:34: error: named already"),
            ("<kernel>:1:1: error: before every file", "<kernel>:1:1: error: before every file"),
            ("<kernel>:x: no number", "<kernel>:x: no number"),
            ("<kernel>:", "<kernel>:"),
            ("", ""),
        ] {
            assert_eq!(source.map_log(log), expected);
        }
    }
}
