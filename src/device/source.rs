//! Assembles the kernel files into one source, and finds the file and line behind a line of a build log.
//!
//! The files are concatenated, each behind `#line 1 "cl/…"`. PoCL's logs then name the file by themselves; NVIDIA's
//! compiler ignores the directive and counts through the whole source (`<kernel>:94:34`), as Oclgrind's does
//! (`input.cl:94:34`): the host maps such places back.

/// A table of kernel files: path from the crate root, text.
macro_rules! kernel_files {
    ($($path:literal),* $(,)?) => { &[$(($path, include_str!(concat!("../../", $path)))),*] };
}

/// The kernel files of every program, one path a line such as `"cl/shared/types.cl"`, in the order in which they are
/// compiled: a file uses only what stands above it.
pub const KERNEL_FILES: &[(&str, &str)] = kernel_files![
    "cl/shared/internal_begin.cl",
    "cl/shared/types.cl",
    "cl/shared/constants.cl",
    "cl/shared/features.cl",
    "cl/shared/math.cl",
    "cl/shared/hash.cl",
    "cl/shared/extended.cl",
    "cl/shared/double_double.cl",
    "cl/shared/integer.cl",
    "cl/memory/geometry.cl",
    "cl/memory/deferral.cl",
    "cl/memory/work.cl",
    "cl/memory/records.cl",
    "cl/memory/shading.cl",
    "cl/shared/instances.cl",
    "cl/lanes/three.cl",
    "cl/shared/rounding_errors.cl",
    "cl/shared/ray.cl",
    "cl/shared/slab.cl",
    "cl/lanes/one.cl",
    "cl/lanes/vectors.cl",
    "cl/intersect/edges.cl",
    "cl/intersect/moller_trumbore.cl",
    "cl/intersect/watertight.cl",
    "cl/intersect/plucker.cl",
    "cl/lanes/eight.cl",
    "cl/lanes/several.cl",
    "cl/lanes/vectors.cl",
    "cl/intersect/edges.cl",
    "cl/intersect/moller_trumbore.cl",
    "cl/intersect/watertight.cl",
    "cl/intersect/plucker.cl",
    "cl/packets/decide.cl",
    "cl/lanes/sixteen.cl",
    "cl/lanes/several.cl",
    "cl/lanes/vectors.cl",
    "cl/shared/rounding_errors.cl",
    "cl/intersect/moller_trumbore.cl",
    "cl/intersect/watertight.cl",
    "cl/intersect/plucker.cl",
    "cl/packets/decide.cl",
    "cl/intersect/filter.cl",
    "cl/intersect/exact_filter.cl",
    "cl/intersect/exact_closer.cl",
    "cl/intersect/exact_integers.cl",
    "cl/intersect/ties.cl",
    "cl/intersect/exact.cl",
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
    "cl/traverse/bvh2.cl",
    "cl/traverse/instances.cl",
    "cl/traverse/wide_stack.cl",
    "cl/traverse/bvh8.cl",
    "cl/packets/ray_packet.cl",
    "cl/packets/frustum.cl",
    "cl/packets/corners.cl",
    "cl/packets/triangles.cl",
    "cl/packets/closely.cl",
    "cl/packets/closer.cl",
    "cl/packets/exactly.cl",
    "cl/packets/finish.cl",
    "cl/packets/single_rays.cl",
    "cl/packets/rounded_tests.cl",
    "cl/packets/rounded.cl",
    "cl/packets/counted.cl",
    "cl/packets/bvh8.cl",
    "cl/packets/group.cl",
    "cl/packets/kd.cl",
    "cl/traverse/grid.cl",
    "cl/traverse/octree.cl",
    "cl/traverse/boxes.cl",
    "cl/traverse/spheres.cl",
    "cl/traverse/query.cl",
    "cl/traverse/batch.cl",
    "cl/packets/load.cl",
    "cl/shade/normal.cl",
    "cl/shade/surface.cl",
    "cl/packets/surfaces.cl",
    "cl/shade/footprint.cl",
    "cl/shade/procedural.cl",
    "cl/shade/texture.cl",
    "cl/shade/light.cl",
    "cl/shade/roulette.cl",
    "cl/shade/whitted.cl",
    "cl/shade/scene.cl",
    "cl/shade/local_light.cl",
    "cl/shade/camera.cl",
    "cl/shared/internal_end.cl",
];

/// What comes behind them: entry points, of which a program has those that it needs. Nobody waits for the compilation
/// of the others.
const ENTRY_FILES: &[(&str, &str)] = kernel_files![
    "cl/kernels/trace.cl",
    "cl/kernels/count_hits.cl",
    "cl/kernels/count_hits_packets.cl",
    "cl/kernels/list_hits_packets.cl",
    "cl/kernels/list_hits.cl",
    "cl/kernels/trace_packets.cl",
    "cl/kernels/render.cl",
    "cl/kernels/render_packets.cl",
    "cl/kernels/add_samples.cl",
    "cl/kernels/wavefront.cl"
];

/// Before all others: what keeps compilers from changing the arithmetic.
const FIRST_FILE: &[(&str, &str)] = kernel_files!["cl/shared/compiler.cl"];

/// A program to try options with.
const EMPTY_FILE: &[(&str, &str)] = kernel_files!["cl/kernels/empty.cl"];

/// Kernels that decide what is traced of pictures of bounded error, and what they need.
const ADAPTIVE_FILES: &[(&str, &str)] =
    kernel_files!["cl/shared/types.cl", "cl/shared/constants.cl", "cl/shared/math.cl", "cl/kernels/adaptive.cl"];

/// The kernel of point queries in a binary hierarchy of boxes, and what it needs.
const CLOSEST_POINT_FILES: &[(&str, &str)] = kernel_files![
    "cl/shared/types.cl",
    "cl/shared/constants.cl",
    "cl/shared/math.cl",
    "cl/lanes/one.cl",
    "cl/lanes/vectors.cl",
    "cl/points/scene.cl",
    "cl/points/distance.cl",
    "cl/points/binary.cl",
    "cl/kernels/closest_point.cl",
];

/// The same in one of eight children a node.
const WIDE_CLOSEST_POINT_FILES: &[(&str, &str)] = kernel_files![
    "cl/shared/types.cl",
    "cl/shared/constants.cl",
    "cl/shared/math.cl",
    "cl/lanes/eight.cl",
    "cl/lanes/several.cl",
    "cl/lanes/vectors.cl",
    "cl/points/scene.cl",
    "cl/packets/corners.cl",
    "cl/traverse/wide_stack.cl",
    "cl/points/distance.cl",
    "cl/points/wide.cl",
    "cl/kernels/closest_point.cl",
];

/// A program that measures the device.
const LIMITS_FILE: &[(&str, &str)] = kernel_files!["cl/kernels/limits.cl"];

/// How compilers that ignore `#line` (NVIDIA's, Oclgrind's) name the source in their logs; the line is then counted
/// through the whole source.
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

    /// A program whose only kernel does nothing.
    pub fn empty() -> Self {
        Self::new(EMPTY_FILE.iter().copied())
    }

    /// The kernels that decide what is traced next of a picture, behind `constants`, which they have from the host.
    pub(super) fn adaptive(constants: &str) -> Self {
        Self::new([("constants", constants)].into_iter().chain(ADAPTIVE_FILES.iter().copied()))
    }

    /// The kernel of point queries: in nodes of eight children if that `is_wide`, else of two.
    pub fn closest_point(is_wide: bool) -> Self {
        Self::new(if is_wide { WIDE_CLOSEST_POINT_FILES } else { CLOSEST_POINT_FILES }.iter().copied())
    }

    /// The kernels that measure what the device can do at most.
    pub fn limits() -> Self {
        Self::new(LIMITS_FILE.iter().copied())
    }

    /// A program of the given files: path as logs shall name it, text. Before them comes `cl/shared/compiler.cl`.
    pub fn new<'a>(files: impl IntoIterator<Item = (&'a str, &'a str)>) -> Self {
        let mut source = ProgramSource { text: String::new(), starts: Vec::new() };
        for (path, text) in FIRST_FILE.iter().copied().chain(files) {
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

    /// Behind the first file: 1 #line, 2-3 a.cl, 4 #line, 5 b.cl, 6 #line, 7 c.cl.
    fn three_files() -> ProgramSource {
        ProgramSource::new([("cl/a.cl", "int a1;\nint a2;\n"), ("cl/b.cl", "int b1;"), ("cl/c.cl", "int c1;\n")])
    }

    /// The lines of the first file and the `#line` before it.
    fn before() -> usize {
        1 + FIRST_FILE[0].1.lines().count()
    }

    #[test]
    fn the_source_names_its_files_and_forbids_contraction() {
        let (path, first) = FIRST_FILE[0];
        assert!(first.contains("#pragma OPENCL FP_CONTRACT OFF\n"));
        let expected =
            "#line 1 \"cl/a.cl\"\nint a1;\nint a2;\n#line 1 \"cl/b.cl\"\nint b1;\n#line 1 \"cl/c.cl\"\nint c1;\n";
        assert_eq!(three_files().text(), format!("#line 1 \"{path}\"\n{first}{expected}"));
    }

    #[test]
    fn every_line_is_located() {
        let source = three_files();
        assert_eq!(source.locate(0), None);
        assert_eq!(source.locate(1), None);
        assert_eq!(source.locate(2), Some(("cl/shared/compiler.cl", 1)));
        let places: Vec<_> = (1..=7).map(|line| source.locate(before() + line)).collect();
        assert_eq!(places[1..3], [Some(("cl/a.cl", 1)), Some(("cl/a.cl", 2))]);
        assert_eq!(places[4], Some(("cl/b.cl", 1)));
        assert_eq!(places[6], Some(("cl/c.cl", 1)));
    }

    #[test]
    fn nvidia_places_are_mapped_and_others_kept() {
        let source = three_files();
        let [a2, b1, c1] = [3, 5, 7].map(|line| before() + line);
        for (log, expected) in [
            (format!("<kernel>:{a2}:34: error: expected ';'"), "cl/a.cl:2:34: error: expected ';'"),
            (format!("<kernel>:{b1}:1: warning: x\nint b1;\n^"), "cl/b.cl:1:1: warning: x\nint b1;\n^"),
            (format!("In file: <kernel>:{c1}:2: note: y"), "In file: cl/c.cl:1:2: note: y"),
            (format!("input.cl:{b1}:3: error: z"), "cl/b.cl:1:3: error: z"),
            (format!("cl/input.cl:{b1}:3: error: z"), &format!("cl/input.cl:{b1}:3: error: z")),
            ("cl/a.cl:2:34: error: named already".into(), "cl/a.cl:2:34: error: named already"),
            ("<kernel>:1:1: error: before every file".into(), "<kernel>:1:1: error: before every file"),
            ("<kernel>:x: no number".into(), "<kernel>:x: no number"),
            ("<kernel>:".into(), "<kernel>:"),
            (String::new(), ""),
        ] {
            assert_eq!(source.map_log(&log), expected);
        }
    }
}
