//! `raybrook devices`.

use super::flags::in_flags;
use super::{CompilerArgs, DEVICE_VARIABLE, MethodArgs, Talk, kernels, print};
use clap::parser::ValueSource;
use raybrook::low_level::device::{devices_json, devices_report, list_devices};
use raybrook::low_level::options::{OPTIONS, StructureKind, TraceOptions};
use raybrook::low_level::scene::PictureDefaults;
use raybrook::{Error, Result};
use std::path::PathBuf;

const KERNELS_HELP: &str = "\
Build the kernels, of the mega-kernel or of those named, and list what each takes: registers and bytes of spills and \
stack frame (NVIDIA only), bytes of private and local memory, largest work-group and its preferred multiple; `-` is \
what the driver does not tell. The kernels of the second pass of --intersector exact come second. All options but \
--json are for this";

/// Of the method options `--kernels` may stand alone here.
fn optional_kernels(argument: clap::Arg) -> clap::Arg {
    let plain = argument.num_args(0..=1).default_missing_value(TraceOptions::DEFAULT.picture.kernels.name());
    plain.hide_short_help(false).help_heading(None::<&str>).help(KERNELS_HELP).long_help(KERNELS_HELP)
}

#[derive(clap::Args)]
#[command(mut_arg("kernels", optional_kernels))]
pub struct DevicesArgs {
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    kernels: KernelsGiven,
    /// Device: its number or a part of its name, cpu or gpu [default: every usable one].
    #[arg(long, value_name = "DEVICE", env = DEVICE_VARIABLE)]
    pub device: Option<String>,
    /// Scene to build the kernels for, which sets the size of stacks [default: a sphere].
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Longest chain of rays [default: 8].
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(PictureDefaults::MAX_DEPTH)),
    )]
    pub depth: Option<u32>,
    #[command(flatten)]
    pub compiler: CompilerArgs,
    /// Build the kernels that count their work.
    #[arg(long)]
    pub(super) counters: bool,
    #[command(flatten)]
    pub(super) method: MethodArgs,
}

/// Whether `--kernels` was given; its value is one of [`MethodArgs`], which takes it away when it is read.
struct KernelsGiven(bool);

impl clap::FromArgMatches for KernelsGiven {
    fn from_arg_matches(matches: &clap::ArgMatches) -> std::result::Result<Self, clap::Error> {
        Ok(KernelsGiven(matches.value_source("kernels") == Some(ValueSource::CommandLine)))
    }

    fn update_from_arg_matches(&mut self, matches: &clap::ArgMatches) -> std::result::Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl clap::Args for KernelsGiven {
    fn augment_args(command: clap::Command) -> clap::Command {
        command
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        command
    }
}

pub fn run(args: &DevicesArgs, talk: Talk) -> Result<()> {
    let options = args.method.options(StructureKind::Kd, args.counters)?;
    if args.kernels.0 {
        return kernels::run(args, talk);
    }
    if let Some(option) = given_for_kernels(args, &options) {
        return Err(Error::option(option, "means nothing to a list of devices; leave it out, or add --kernels"));
    }
    let list = list_devices()?;
    if args.json {
        print::json_text(&devices_json(&list));
    } else {
        say!("{}", in_flags(devices_report(&list).trim_end()));
    }
    Ok(())
}

/// The first option that only `--kernels` reads. Not `--device`, which the environment sets, too.
fn given_for_kernels(args: &DevicesArgs, options: &TraceOptions) -> Option<&'static str> {
    let given = [
        ("--scene", args.scene.is_some()),
        ("--depth", args.depth.is_some()),
        ("--counters", args.counters),
        ("--compiler-options", args.compiler.compiler_options.is_some()),
    ];
    let method = OPTIONS.iter().map(|option| (option.name, option.is_set(options)));
    given.into_iter().chain(method).find(|(_, is_given)| *is_given).map(|(name, _)| name)
}
