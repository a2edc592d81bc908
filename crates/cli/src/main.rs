//! The command line: what can be asked for, and its conversion to the library's types. Together with `main.rs` this is the only
//! code that prints, reads arguments or decides exit codes.

#[macro_use]
mod print;

mod check;
mod closed;
mod devices;
mod end;
mod explain;
mod files;
mod info;
mod kd;
mod kernels;
mod methods;
mod open;
mod progress;
mod render;
mod stop;
mod stress;
mod study;
mod text;
mod trace;
mod tune;
mod work;

use end::fail;

use clap::{Args, Parser, Subcommand};
use raybrook::Error;
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::options::{
    Accel, Build, Chosen, Decisions, Intersector, KernelFeatures, Kernels, Layout, Memory, NodeOrder, PacketSize,
    RayOrder, Request, Terminator, TextureFilter, TexturePass, TraceOptions, Traversal, TriangleOrder, TunedChoice,
    Workload,
};
use raybrook::low_level::scene::{PictureDefaults, Samples};
use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

const AFTER_HELP: &str = "\
Exit codes: 0 done; 1 `check` found a difference above its tolerance, `stress` a wrong answer, or `tune` different ones; 2 wrong option or argument; 3 the scene or another input is \
missing or wrong, or takes more memory than there is; 4 no such device, or the device failed, or the picture takes more memory than there is; 5 an output could not be \
written; 129, 130, 143 stopped by SIGHUP, SIGINT, SIGTERM.

Environment: RAYBROOK_DEVICE sets the default of --device; RAYBROOK_CACHE_DIR the folder of compiled kernels and of what `tune` found (default: \
$XDG_CACHE_HOME/raybrook or ~/.cache/raybrook), RAYBROOK_CACHE_MB how many megabytes they may take (default: 512; those not used for \
longest are removed first, 0 keeps nothing); RAYBROOK_DRIVER_LIMIT how many seconds a call of the device's driver may take (default: 30 for \
a release, 600 and more for others; 0 waits for ever); NO_COLOR switches colours off.";

/// Fast and right ray tracing of triangle scenes on any OpenCL device, checked against a scalar reference.
#[derive(Parser)]
#[command(version, about, after_help = AFTER_HELP)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    talk: Talk,
}

/// How much to say.
#[derive(Args, Clone, Copy)]
struct Talk {
    /// Say nothing but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Say more: device, times, every warning.
    #[arg(short, long, global = true)]
    verbose: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene to a picture.
    Render(render::RenderArgs),
    /// Trace a batch of rays from a NumPy .npz file.
    Trace(trace::TraceArgs),
    /// Render on a device and on the reference, and compare.
    Check(check::CheckArgs),
    /// Tell what is in a scene and how its tree turns out.
    Info(info::InfoArgs),
    /// List the OpenCL devices, or what is missing to have one.
    Devices(devices::DevicesArgs),
    /// List the interchangeable parts and what goes together with what.
    Methods(methods::MethodsArgs),
    /// Trace hard rays whose exact answers are known, and count the wrong ones.
    Stress(stress::StressArgs),
    /// Measure methods against each other on a device, speed beside accuracy, and write a report of charts and tables. Goes on
    /// where it was stopped.
    Study(study::StudyArgs),
    /// Measure which structure and packet size are fastest on a device, and remember that for --accel auto. Closest hits and
    /// pictures stay the same, whatever is found.
    Tune(tune::TuneArgs),
}

/// What to trace with.
#[derive(Args)]
struct MethodArgs {
    #[arg(long, help = format!("Structure: {}, or auto: what `raybrook tune` found on the device, else bvh8 on a CPU, bvh2 on a GPU, on the reference kd for 100 to 299999 triangles and bvh2 for fewer or more, instances where these share a million triangles, on a GPU 65536, or what other options are for, such as kd with --build (info and tables of methods prefer kd)", Accel::names()), value_name = "NAME", default_value = "auto")]
    accel: AccelChoice,
    #[arg(long, help = format!("How the kd-tree is built: {}", Build::names()), value_name = "NAME", default_value_t = TraceOptions::default().build)]
    build: Build,
    #[arg(long, help = format!("How rays walk through the kd-tree: {}; thesis-restart loses hits and is there for study", Traversal::names()), value_name = "NAME", default_value_t = TraceOptions::default().traversal)]
    traversal: Traversal,
    /// Entries of the short stack, 1 to 60; only with --traversal short-stack [default: 8].
    #[arg(long, value_name = "K")]
    stack_size: Option<u32>,
    #[arg(long, help = format!("Rays that are traced together: {}; 16 only with bvh8 or kd by a full stack, and exact hits [default: what `raybrook tune` found; else 16 there on a CPU, else 1]", PacketSize::names()), value_name = "N")]
    packet_size: Option<PacketSize>,
    #[arg(long, help = format!("Order in which a batch's rays are traced, hits coming back in the batch's: {}; auto sorts large shuffled batches for packets on a CPU", RayOrder::names()), value_name = "NAME", default_value_t = TraceOptions::default().ray_order)]
    ray_order: RayOrder,
    #[arg(long, help = format!("Ray-triangle test: {}; on a CPU all but exact are slower, because only with exact hits do rays go in packets [default: {}]", Intersector::names(), TraceOptions::DEFAULT.intersector), value_name = "NAME")]
    intersector: Option<Intersector>,
    /// Short for an --intersector: exact hits, or the fastest float32 test, which loses some: moller-trumbore. On a CPU "fast" is 3 to
    /// 4 times slower than exact: only with exact hits do rays go in packets there.
    #[arg(long, value_name = "exact|fast", value_parser = parse_precision, conflicts_with = "intersector")]
    precision: Option<Intersector>,
    /// Do not split nodes of up to N triangles [default: 1 with --stop cost, where the cost decides; with --stop size 12 for median
    /// and sampled-median, 8 for spatial-median, 4 for sah and volume; 8 for octree];
    /// put no more than N into a leaf of bvh2 [default: 8; at most 15] or bvh8 [default and at most 8];
    /// put up to N into one box or sphere [default: the square root of the triangles].
    #[arg(long, value_name = "N")]
    leaf_size: Option<u32>,
    /// Make no leaf deeper than this; the root is 0 [default: 8 + 1.3 log2(triangles), 4 + 0.5 log2(triangles) for octree; at
    /// most 60].
    #[arg(long, value_name = "N")]
    max_depth: Option<u32>,
    /// Improve a finished bvh2 or bvh8 in up to N passes, each of which moves large subtrees to where they fit better; 0: none
    /// [default: 5].
    #[arg(long, value_name = "N")]
    reinsert: Option<u32>,
    /// Cut long and large triangles in bvh2 or bvh8, which makes up to X more references per triangle, 0 to 4; 0: none [default: 0].
    #[arg(long, value_name = "X")]
    spatial_splits: Option<f32>,
    #[command(flatten)]
    kd: kd::KdArgs,
    /// Cells of the grid along the axes [default: nearly cubic ones, about 8 for each triangle].
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_grid_size)]
    grid_size: Option<[u32; 3]>,
    #[arg(long, help = format!("Where nodes and triangles lie on the device: {}", Memory::names()), value_name = "NAME", default_value_t = TraceOptions::default().memory)]
    memory: Memory,
    #[arg(long, help = format!("Shading data apart from the vertices or with them: {}", Layout::names()), value_name = "NAME", default_value_t = TraceOptions::default().layout)]
    layout: Layout,
    #[arg(long, help = format!("Order of the kd-tree's nodes: {}", NodeOrder::names()), value_name = "NAME", default_value_t = TraceOptions::default().node_order)]
    node_order: NodeOrder,
    #[arg(long, help = format!("Vertices by number, or copied for each leaf: {}", TriangleOrder::names()), value_name = "NAME", default_value_t = TraceOptions::default().triangles)]
    triangles: TriangleOrder,
    #[arg(long, help = format!("Kernels that render: {}", Kernels::names()), value_name = "NAME", default_value_t = TraceOptions::default().kernels)]
    kernels: Kernels,
    #[arg(long, help = format!("Who evaluates textures: {}; host-pass only with --kernels split", TexturePass::names()), value_name = "NAME", default_value_t = TraceOptions::default().textures)]
    textures: TexturePass,
    #[arg(long, help = format!("What colour a ray takes from a picture on a surface: {}", TextureFilter::names()), value_name = "NAME", default_value_t = TraceOptions::default().texture_filter)]
    texture_filter: TextureFilter,
    #[arg(long, help = format!("Who decides what is traced next of a picture whose error is asked for: {}", Decisions::names()), value_name = "NAME", default_value_t = TraceOptions::default().decisions)]
    decisions: Decisions,
    #[arg(long, help = format!("What the kernels of pictures can do: {}", KernelFeatures::names()), value_name = "NAME", default_value_t = TraceOptions::default().features)]
    features: KernelFeatures,
    #[arg(long, help = format!("Shadow rays start at the height that smooth normals claim, or on the triangle, where coarse meshes show stairs: {}", Terminator::names()), value_name = "NAME", default_value_t = TraceOptions::default().terminator)]
    terminator: Terminator,
    /// Paths (samples of pixels) that --kernels split follows at a time [default: as many as fit into 256 MiB].
    #[arg(long, value_name = "N")]
    paths_in_flight: Option<u32>,
}

/// A structure, or the choice of one.
#[derive(Clone, Copy)]
enum AccelChoice {
    Auto,
    Only(Accel),
}

impl FromStr for AccelChoice {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let no_accel = |_| Error::option(Accel::OPTION, format!("no '{text}'; possible: auto, {}", Accel::names()));
        if text == "auto" { Ok(AccelChoice::Auto) } else { text.parse().map(AccelChoice::Only).map_err(no_accel) }
    }
}

impl MethodArgs {
    /// What is wrong with the options on any device comes before what takes time.
    fn check(&self, counters: bool) -> Result<TraceOptions, Error> {
        Ok(self.request(counters).choose(&without_scene(None), None)?.options)
    }

    /// The options, with what is fastest on `device` where the user leaves the choice, for no scene in particular.
    fn options_for(&self, device: Option<&DeviceHandle>, counters: bool, talk: Talk) -> Result<TraceOptions, Error> {
        Ok(self.choose(&without_scene(device), None, counters, talk)?.options)
    }

    /// Chooses what the user leaves open. Says so where a limit of the fastest structure leads to another one, which nobody asked for.
    fn choose(
        &self,
        workload: &Workload,
        tuned: Option<&TunedChoice>,
        counters: bool,
        talk: Talk,
    ) -> Result<Chosen, Error> {
        let chosen = self.request(counters).choose(workload, tuned)?;
        if let Some(limit) = chosen.limit.as_ref().filter(|_| !talk.quiet) {
            tell!("note: --accel auto takes {}: {limit}", chosen.options.accel);
        }
        Ok(chosen)
    }

    /// Whether structure or packets are left to be chosen.
    fn leaves_a_choice(&self) -> bool {
        matches!(self.accel, AccelChoice::Auto) || self.packet_size.is_none()
    }

    /// The options, with the `preferred` structure where the user leaves the choice and nothing else needs another one.
    fn options(&self, preferred: Accel, counters: bool) -> Result<TraceOptions, Error> {
        self.request(counters).with_structure(preferred)
    }

    /// What the user asks for.
    fn request(&self, counters: bool) -> Request {
        let rest = TraceOptions {
            build: self.build,
            traversal: self.traversal,
            stack_size: self.stack_size,
            ray_order: self.ray_order,
            leaf_size: self.leaf_size,
            max_depth: self.max_depth,
            reinsert: self.reinsert,
            spatial_splits: self.spatial_splits,
            kd: self.kd.options(),
            grid_size: self.grid_size,
            memory: self.memory,
            layout: self.layout,
            node_order: self.node_order,
            triangles: self.triangles,
            kernels: self.kernels,
            textures: self.textures,
            features: self.features,
            texture_filter: self.texture_filter,
            decisions: self.decisions,
            terminator: self.terminator,
            paths_in_flight: self.paths_in_flight,
            counters,
            ..TraceOptions::DEFAULT
        };
        let accel = match self.accel {
            AccelChoice::Auto => None,
            AccelChoice::Only(accel) => Some(accel),
        };
        Request { accel, packet_size: self.packet_size, intersector: self.precision.or(self.intersector), rest }
    }
}

/// Batches of rays on `device` through whatever scene.
fn without_scene(device: Option<&DeviceHandle>) -> Workload<'_> {
    Workload { device: device.map(|device| &device.info), triangle_count: None, features: None, shared_triangles: 0 }
}

/// The variable that sets the default of `--device`.
const DEVICE_VARIABLE: &str = "RAYBROOK_DEVICE";

/// Where to trace.
#[derive(Args)]
struct DeviceArgs {
    /// Device: its number or a part of its name (see `raybrook devices`), cpu, gpu, or reference
    /// [default: the fastest GPU, else a CPU, else the reference].
    #[arg(long, value_name = "DEVICE", env = DEVICE_VARIABLE)]
    device: Option<String>,
    /// Compile the kernels anew, ignore what `raybrook tune` found, and keep nothing.
    #[arg(long)]
    no_cache: bool,
    #[command(flatten)]
    compiler: CompilerArgs,
}

impl DeviceArgs {
    /// Where compiled kernels are kept, if they are.
    fn cache(&self) -> Result<Option<Cache>, Error> {
        if self.no_cache { Ok(None) } else { Cache::open() }
    }
}

/// What the device's compiler gets.
#[derive(Args)]
struct CompilerArgs {
    /// Further options for the device's compiler, such as "-cl-mad-enable -w"; the hits stay the same, see README for what was
    /// tested.
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    compiler_options: Option<String>,
}

impl CompilerArgs {
    /// The device with these options.
    fn apply(&self, device: DeviceHandle) -> Result<DeviceHandle, Error> {
        match &self.compiler_options {
            Some(options) => device.with_compiler_options(options),
            None => Ok(device),
        }
    }
}

/// Overrides of what the scene says of its picture.
#[derive(Args)]
struct PictureArgs {
    /// Width and height in pixels [default: the scene's, else 1024x768].
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// The picture's error that is asked for, in steps of 8-bit sRGB (root of the mean square): more samples go only where they
    /// lower it, up to 256 a pixel, and from 2 on some pixels are interpolated [default: the scene's, else 1].
    #[arg(long, value_name = "E", conflicts_with = "samples")]
    error: Option<f32>,
    /// Samples per pixel, in a fixed pattern, or `corners`: one ray through each corner, so that 513x513 rays lie around 512x512
    /// pixels [default: as many as --error takes].
    #[arg(long, value_name = "N|corners")]
    samples: Option<Samples>,
    /// Longest chain of reflected and refracted rays; 1 is the camera ray alone [default: the scene's, else 8].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(PictureDefaults::MAX_DEPTH)))]
    depth: Option<u32>,
    /// Do not cast secondary rays of less weight; 0 casts all [default: what cannot change an 8-bit pixel,
    /// or one by half of the --error that is asked for].
    #[arg(long, value_name = "W", value_parser = parse_weight)]
    kill_weight: Option<f32>,
}

fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X']).and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match parts {
        Some((w, h))
            if (1..=PictureDefaults::MAX_SIDE).contains(&w) && (1..=PictureDefaults::MAX_SIDE).contains(&h) =>
        {
            Ok((w, h))
        }
        _ => Err(format!("expected WIDTHxHEIGHT with sides of 1 to {}, such as 1280x720", PictureDefaults::MAX_SIDE)),
    }
}

fn parse_grid_size(text: &str) -> Result<[u32; 3], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    let size = numbers.and_then(|numbers| <[u32; 3]>::try_from(numbers).ok());
    size.ok_or_else(|| "expected three numbers of cells, such as 32,32,16".into())
}

fn parse_precision(text: &str) -> Result<Intersector, String> {
    match text {
        "exact" => Ok(Intersector::Exact),
        "fast" => Ok(Intersector::FASTEST),
        _ => Err("possible: exact, fast".into()),
    }
}

fn parse_weight(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(weight) if (0.0..=1.0).contains(&weight) => Ok(weight),
        _ => Err("expected a number from 0 to 1".into()),
    }
}

/// A scene to work on.
#[derive(Args)]
struct SceneArgs {
    /// Scene: a .toml scene file (see scenes/README.md), a Wavefront .obj, a .ply, a .stl or Haines' .nff.
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Take a scene file without any object: every ray misses.
    #[arg(long)]
    allow_empty: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// How much memory may be taken.
#[derive(Args, Clone, Copy)]
struct MemoryArgs {
    /// Refuse what takes the program to more memory than this, such as 8G or 512M, before it is taken [default: nine
    /// tenths of what the machine has available, its container has left, or ulimit leaves].
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    memory_limit: Option<u64>,
}

impl MemoryArgs {
    /// What may be taken, now.
    fn budget(self) -> MemoryBudget {
        self.memory_limit.map_or_else(MemoryBudget::available, MemoryBudget::of_bytes)
    }
}

/// A number of bytes, with K, M, G or T behind it for powers of 1024.
fn parse_bytes(text: &str) -> Result<u64, String> {
    let lower = text.trim().to_ascii_lowercase();
    let digits = lower.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let factor: Option<f64> = match &lower[digits.len()..] {
        "" | "b" => Some(1.0),
        "k" | "kb" | "kib" => Some(1024.0),
        "m" | "mb" | "mib" => Some(1024f64.powi(2)),
        "g" | "gb" | "gib" => Some(1024f64.powi(3)),
        "t" | "tb" | "tib" => Some(1024f64.powi(4)),
        _ => None,
    };
    let bytes = digits.trim().parse::<f64>().ok().zip(factor).map(|(number, factor)| number * factor);
    match bytes.filter(|&bytes| (1.0..9e18).contains(&bytes)) {
        Some(bytes) => Ok(bytes as u64),
        None => Err("expected a number of bytes above 0, such as 8G, 512M or 1.5g".into()),
    }
}

/// Has PoCL keep each of its threads on a core of its own, unless the user has said how its threads are to run. Otherwise Linux often
/// wakes two of them on one core, and leaves them there for the first 50 to 150 ms: the time of a whole picture, at half of the speed.
fn keep_threads_on_their_cores() {
    if ["POCL_AFFINITY", "POCL_MAX_PTHREAD_COUNT"].iter().all(|name| std::env::var_os(name).is_none()) {
        // SAFETY: nothing but this thread runs yet, so nobody reads the environment meanwhile.
        unsafe { std::env::set_var("POCL_AFFINITY", "1") };
    }
}

/// Has empty variables of this program mean what those mean that are not set: shells and services make such.
fn forget_empty_variables() {
    let is_ours = |name: &OsStr| name.as_encoded_bytes().starts_with(b"RAYBROOK_");
    for (name, _) in std::env::vars_os().filter(|(name, value)| value.is_empty() && is_ours(name)) {
        // SAFETY: nothing but this thread runs yet, so nobody reads the environment meanwhile.
        unsafe { std::env::remove_var(name) };
    }
}

/// Parses the arguments and does what they ask. To be called before any thread is started.
pub fn run() -> Result<ExitCode, Error> {
    keep_threads_on_their_cores();
    forget_empty_variables();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(other) => return Ok(end_of_arguments(&other)),
    };
    if let Err(error) = stop::watch_signals() {
        tell!("warning: files that are not finished will be left behind when the program is stopped: {error}");
    }
    end::watch_drivers(cli.talk)?;
    match cli.command {
        Command::Render(args) => render::run(&args, cli.talk).map(|()| ExitCode::SUCCESS),
        Command::Trace(args) => trace::run(&args, cli.talk).map(|()| ExitCode::SUCCESS),
        Command::Check(args) => check::run(&args, cli.talk),
        Command::Info(args) => info::run(&args, cli.talk).map(|()| ExitCode::SUCCESS),
        Command::Devices(args) => devices::run(&args, cli.talk).map(|()| ExitCode::SUCCESS),
        Command::Methods(args) => methods::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Stress(args) => stress::run(&args, cli.talk),
        Command::Study(args) => study::run(&args, cli.talk).map(|()| ExitCode::SUCCESS),
        Command::Tune(args) => tune::run(&args, cli.talk),
    }
}

/// Prints help, the version, or what is wrong with the arguments, and returns the exit code.
fn end_of_arguments(other: &clap::Error) -> ExitCode {
    let is_safe = |text: &OsStr| text.to_str().is_some_and(|text| print::escaped(text) == text);
    // Help shows the variable, too.
    let is_all_safe = std::env::args_os().chain(std::env::var_os(DEVICE_VARIABLE)).all(|text| is_safe(&text));
    let is_wrong = other.use_stderr();
    // Without colours where what is quoted could not be told from them.
    let text = other.render().to_string();
    match (is_wrong, is_all_safe) {
        (false, true) => print::remember(other.print()),
        (false, false) => say!("{}", text.trim_end()),
        // Whether anyone can read it changes nothing.
        (true, true) => _ = other.print(),
        (true, false) => tell!("{}", text.trim_end()),
    }
    if is_wrong { ExitCode::from(WRONG_ARGUMENTS) } else { ExitCode::SUCCESS }
}

/// The exit code of a wrong option or argument; that of [`Error::Option`].
const WRONG_ARGUMENTS: u8 = 2;

/// An error and what caused it, in one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        text += &format!(": {cause}");
        next = cause.source();
    }
    text
}

/// Parses, runs, prints the chain of errors, and exits with the documented code.
fn main() -> ExitCode {
    let code = run().unwrap_or_else(|error| fail(&error));
    print::finish(code)
}
