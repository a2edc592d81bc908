//! The command line: what can be asked for, and its conversion to the library's types. Nothing else prints, reads
//! arguments or decides exit codes.
//!
//! The program's `main` and the Python package, as `python -m raybrook`, call [`run`].

#[macro_use]
mod print;

/// Headings of the help, beside those of the options of methods.
mod heading {
    pub const PICTURE: &str = "Picture";
    pub const CAMERA: &str = "Camera";
    pub const DEVICE: &str = "Device";
    pub const OUTPUT: &str = "Output";
    pub const DIAGNOSIS: &str = "Diagnosis";
}

mod asked;
#[cfg(test)]
mod book;
mod camera;
mod check;
mod closed;
mod code;
mod devices;
mod display;
mod distance;
mod end;
mod explain;
mod files;
mod flags;
#[doc(hidden)]
pub mod fuzzed;
mod info;
mod inside;
mod keep;
mod keep_rays;
mod kernels;
mod layers;
mod limit;
mod log;
mod loss;
mod merge;
mod merge_rays;
mod method;
mod methods;
mod open;
mod part;
mod picture_file;
mod points;
mod progress;
mod render;
mod several;
mod shell;
mod stop;
mod stress;
mod study;
mod text;
mod trace;
mod truth;
mod tune;
mod turntable;
mod values;
mod view;
mod warm_up;
mod work;

use code::{Code, SUCCESS, WRONG_ARGUMENTS};
use end::fail;
use method::MethodArgs;

use clap::{Args, Parser, Subcommand};
use raybrook::Error;
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::scene::{PictureDefaults, Samples};
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::sync::OnceLock;

const AFTER_HELP: &str = "\
Exit codes: 0 done; 1 `check` found a difference above its tolerance, `stress` a wrong answer, or `tune` different \
answers; 2 wrong option or argument; 3 the scene or another input is missing or wrong, or takes more memory than there \
is; 4 no such device, or the device failed, or the picture takes more memory than there is; 5 an output could not be \
written; 124 --time-limit or --deadline was met, and the same command goes on; 129, 130, 143 stopped by SIGHUP, \
SIGINT, SIGTERM.

Environment: RAYBROOK_DEVICE sets the default of --device; RAYBROOK_CACHE_DIR the folder of compiled kernels and of \
what `tune` found (default: $XDG_CACHE_HOME/raybrook or ~/.cache/raybrook), RAYBROOK_CACHE_MB how many megabytes they \
may take (default: 512; those not used for longest are removed first, 0 keeps nothing); RAYBROOK_DRIVER_LIMIT how many \
seconds a call of the device's driver may take (default: 30 for a release, 600 and more for others; 0 waits for ever); \
NO_COLOR switches colours off.";

/// Fast and exact ray tracing of triangle scenes on graphics cards and processors.
#[derive(Parser)]
#[command(name = "raybrook", version, about, after_help = AFTER_HELP)]
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
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = heading::OUTPUT)]
    quiet: bool,
    /// Say more: device, times, every warning.
    #[arg(short, long, global = true, help_heading = heading::OUTPUT)]
    verbose: bool,
    /// How to tell how far long work is: by a bar on a terminal, or by lines of JSON for programs that wrap this one.
    ///
    /// With json all that is written to standard error is JSON, an object a line; the book's page "Many cores, many
    /// machines" describes it. `bar` or `json`.
    #[arg(
        long,
        global = true,
        hide_short_help = true,
        value_name = "FORM",
        default_value = "bar",
        help_heading = heading::OUTPUT,
    )]
    progress: progress::Form,
}

#[derive(Subcommand)]
enum Command {
    /// Render a scene to a picture.
    Render(render::RenderArgs),
    /// Merge the parts of a picture, or of a batch of rays, that several machines made, or write what a stopped run has
    /// left.
    Merge(merge::MergeArgs),
    /// Show a scene in the browser: move about, pick, compare methods.
    View(view::ViewArgs),
    /// Render a scene from all around: numbered pictures, by one tracer. Goes on where it was stopped.
    Turntable(turntable::TurntableArgs),
    /// Trace a batch of rays from a NumPy .npz file.
    Trace(trace::TraceArgs),
    /// Tell which points of a NumPy .npz file are inside of a closed mesh.
    Inside(inside::InsideArgs),
    /// Find what of a scene is closest to the points of a NumPy .npz file, and how far it is.
    Distance(distance::DistanceArgs),
    /// Render on a device and on the reference, and compare; or with --truth, check the picture by independent code.
    Check(check::CheckArgs),
    /// Tell what is in a scene, and figures of its search structure.
    Info(info::InfoArgs),
    /// List the OpenCL devices, or what is missing to have one.
    Devices(devices::DevicesArgs),
    /// List the parts of methods, and which of them cannot be combined.
    Methods(methods::MethodsArgs),
    /// Trace hard rays whose exact answers are known, and count the wrong ones.
    Stress(stress::StressArgs),
    /// Measure methods against each other on a device, speed beside accuracy, and write a report of charts and tables.
    /// Goes on where it was stopped.
    Study(study::StudyArgs),
    /// Measure which structure and packet size are fastest on a device, and remember that for later runs. Closest hits
    /// and pictures stay the same, whatever is found.
    Tune(tune::TuneArgs),
    /// Compile a device's kernels in advance, so that later runs begin at once: at installation, or in a container's
    /// image.
    WarmUp(warm_up::WarmUpArgs),
    /// Print what a shell needs to complete commands and options.
    Completions(shell::CompletionsArgs),
    /// Write the manual pages.
    Man(shell::ManArgs),
}

/// The variable that sets the default of `--device`.
const DEVICE_VARIABLE: &str = "RAYBROOK_DEVICE";

/// Where to trace.
#[derive(Args)]
struct DeviceArgs {
    /// Where to compute: gpu, cpu, reference (without OpenCL), or a number or part of a name from `raybrook devices`
    /// [default: the fastest].
    ///
    /// The default is the fastest GPU, else a CPU, else the reference, which is scalar code on all cores. `render` and
    /// `trace` take several, such as 0,2 or gpu+cpu, or all, which is all GPUs where there are any: they share the
    /// work, and the bits are the same.
    #[arg(long, help_heading = heading::DEVICE, value_name = "DEVICE", env = DEVICE_VARIABLE, hide_env_values = true)]
    device: Option<String>,
    /// Neither read nor write the cache: compiled kernels, and what `raybrook tune` found.
    #[arg(long, help_heading = heading::DEVICE)]
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
    /// Further options for the device's compiler, such as "-cl-mad-enable -w".
    ///
    /// The hits stay the same; the book's page on runtimes tells what was tested.
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    #[arg(hide_short_help = true, help_heading = heading::DIAGNOSIS)]
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
    #[arg(long, help_heading = heading::PICTURE, value_name = "WxH", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Allowed error (noise), in steps of 8-bit brightness, 0 to 255; smaller is better and slower [default: the
    /// scene's, else 1].
    ///
    /// It is the root of the mean square, in steps of 8-bit sRGB. More samples go only where they lower it, up to 256 a
    /// pixel, and from 2 on some pixels are interpolated.
    #[arg(long, help_heading = heading::PICTURE, value_name = "E", conflicts_with = "samples")]
    error: Option<f32>,
    /// Samples per pixel, in place of --error [default: chosen by --error].
    ///
    /// They lie in a fixed pattern. `corners`: one ray through each corner, so that 513x513 rays lie around 512x512
    /// pixels.
    #[arg(long, help_heading = heading::PICTURE, value_name = "N|corners")]
    samples: Option<Samples>,
    /// Longest chain of rays through mirrors and glass, the camera ray counted; 1: none is mirrored or refracted
    /// [default: the scene's, else 8].
    #[arg(long, help_heading = heading::PICTURE, value_name = "N")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=i64::from(PictureDefaults::MAX_DEPTH)))]
    depth: Option<u32>,
    /// Do not cast secondary rays of less weight; 0 casts all [default: what cannot change an 8-bit pixel, or
    /// changes it by less than half of --error].
    #[arg(long, help_heading = heading::PICTURE, hide_short_help = true, value_name = "W", value_parser = parse_weight)]
    kill_weight: Option<f32>,
    #[command(flatten)]
    camera: camera::CameraArgs,
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

fn parse_weight(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(weight) if (0.0..=1.0).contains(&weight) => Ok(weight),
        _ => Err("expected a number from 0 to 1".into()),
    }
}

/// A scene to work on.
#[derive(Args)]
struct SceneArgs {
    /// The scene: a model (.obj, .ply, .stl, .gltf, .glb, .off, .3mf, .nff) or a scene file (.toml, see the book's page
    /// on scenes).
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Take a scene file without any object: every ray misses.
    #[arg(long, hide_short_help = true, help_heading = heading::DIAGNOSIS)]
    allow_empty: bool,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// How much memory may be taken.
#[derive(Args, Clone, Copy)]
struct MemoryArgs {
    /// Memory limit, such as 8G or 512M [default: 90 % of the free memory].
    ///
    /// What would take the program to more is refused before it is taken. Free is what the machine has available, its
    /// container has left, or ulimit leaves, whichever is least.
    #[arg(long, help_heading = heading::DEVICE, value_name = "SIZE", value_parser = parse_bytes)]
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

/// Has PoCL keep each of its threads on a core of its own, unless the user has said how its threads are to run.
/// Otherwise Linux often wakes two of them on one core, and leaves them there for the first 50 to 150 ms: the time of a
/// whole picture, at half of the speed.
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

/// What was typed, the program's name first.
static ARGUMENTS: OnceLock<Vec<OsString>> = OnceLock::new();

/// What was typed behind the program's name.
fn words() -> impl Iterator<Item = &'static OsString> {
    ARGUMENTS.get().into_iter().flatten().skip(1)
}

/// Does what `arguments` ask, the program's name first, prints the chain of errors, and tells the documented exit code,
/// with which the process is to end. To be called once, and before any thread is started that reads the environment:
/// signals are this program's from then on.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = ARGUMENTS.get_or_init(|| arguments.into_iter().collect());
    let code = end::leave(print::finish(obey(arguments).unwrap_or_else(|error| fail(&error))));
    progress::end_json(code);
    code
}

/// Whether events are asked for, also where other arguments are wrong: that is then an event.
fn asks_for_json(arguments: &[OsString]) -> bool {
    let is_pair = |pair: &[OsString]| pair[0] == "--progress" && pair[1] == "json";
    arguments.windows(2).any(is_pair) || arguments.iter().any(|argument| argument == "--progress=json")
}

/// Parses the arguments and does what they ask.
fn obey(arguments: &[OsString]) -> Result<Code, Error> {
    keep_threads_on_their_cores();
    forget_empty_variables();
    if asks_for_json(arguments) {
        progress::begin_json();
    }
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(other) => return Ok(end_of_arguments(&other)),
    };
    if let Err(error) = stop::watch_signals() {
        tell!("warning: files that are not finished will be left behind when the program is stopped: {error}");
    }
    end::watch_drivers(cli.talk)?;
    if !cli.talk.quiet {
        method::note_old_names(words().map(|word| word.to_string_lossy().into_owned()));
    }
    match cli.command {
        Command::Render(args) => render::run(&args, cli.talk),
        Command::Merge(args) => merge::run(&args, cli.talk).map(|()| SUCCESS),
        Command::View(args) => view::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Turntable(args) => turntable::run(&args, cli.talk),
        Command::Trace(args) => trace::run(&args, cli.talk),
        Command::Inside(args) => inside::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Distance(args) => distance::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Check(args) => check::run(&args, cli.talk),
        Command::Info(args) => info::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Devices(args) => devices::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Methods(args) => methods::run(&args).map(|()| SUCCESS),
        Command::Stress(args) => stress::run(&args, cli.talk),
        Command::Study(args) => study::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Tune(args) => tune::run(&args, cli.talk),
        Command::WarmUp(args) => warm_up::run(&args, cli.talk).map(|()| SUCCESS),
        Command::Completions(args) => {
            shell::completions(&args);
            Ok(SUCCESS)
        }
        Command::Man(args) => shell::man(&args).map(|()| SUCCESS),
    }
}

/// Prints help, the version, or what is wrong with the arguments, and returns the exit code.
fn end_of_arguments(other: &clap::Error) -> Code {
    let is_safe = |text: &OsStr| text.to_str().is_some_and(|text| print::escaped(text) == text);
    // Help shows the variable, too.
    let typed = ARGUMENTS.get().into_iter().flatten().cloned();
    let is_all_safe = typed.chain(std::env::var_os(DEVICE_VARIABLE)).all(|text| is_safe(&text));
    let is_wrong = other.use_stderr();
    // Without colours where what is quoted could not be told from them.
    let text = other.render().to_string();
    match (is_wrong, is_all_safe && !(is_wrong && progress::is_json())) {
        (false, true) => print::remember(other.print()),
        (false, false) => say!("{}", text.trim_end()),
        // Whether anyone can read it changes nothing.
        (true, true) => _ = other.print(),
        (true, false) => tell!("{}", text.trim_end()),
    }
    if is_wrong { WRONG_ARGUMENTS } else { SUCCESS }
}

/// An error and what caused it, in one line.
fn chain(error: &Error) -> String {
    with_causes(flags::message(error), error)
}

/// `text`, which tells of `error`, and behind it what caused that.
pub fn with_causes(mut text: String, error: &Error) -> String {
    let mut next = std::error::Error::source(error);
    while let Some(cause) = next {
        text += &format!(": {cause}");
        next = cause.source();
    }
    text
}
