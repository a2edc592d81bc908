//! `raybrook devices --kernels`: what the kernels take of each device.

use super::devices::DevicesArgs;
use super::text::wrapped;
use super::{Talk, open, print};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::device::{
    DeviceHandle, KernelResources, Looked, ProgramResources, Selection, kernel_resources, list_devices, select,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{DEFAULT_DEPTH, complete};
use raybrook::low_level::scene::{Builder, Scene};
use raybrook::{Error, Result};
use serde::Serialize;
use std::fmt::Write;

/// Segments of the sphere that stands for a scene: 9800 triangles, so that the tree has a usual depth and is larger
/// than constant memory.
const SEGMENTS: u32 = 100;

/// A column of the table: its heading, and the number below it.
type Column = (&'static str, fn(&KernelResources) -> Option<u64>);

const COLUMNS: [Column; 8] = [
    ("registers", |kernel| kernel.registers),
    ("spill stores", |kernel| kernel.spill_store_bytes),
    ("spill loads", |kernel| kernel.spill_load_bytes),
    ("frame", |kernel| kernel.stack_frame_bytes),
    ("private", |kernel| kernel.private_memory_bytes),
    ("local", |kernel| kernel.local_memory_bytes),
    ("group", |kernel| kernel.max_work_group_size),
    ("multiple", |kernel| kernel.preferred_work_group_multiple),
];

/// A device with what its kernels take, or why they do not build.
#[derive(Serialize)]
struct Entry {
    index: usize,
    device: String,
    programs: Vec<ProgramResources>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

pub fn run(args: &DevicesArgs, talk: Talk) -> Result<()> {
    let devices = devices(args.device.as_deref())?;
    let scene = match &args.scene {
        Some(path) => open::load(path, &MemoryBudget::available(), talk)?.scene,
        None => sphere()?,
    };
    let mut entries = Vec::new();
    let mut errors = Vec::new();
    for device in devices {
        let device = args.compiler.apply(device)?;
        let options = args.method.options_for(Some(&device), args.counters, talk)?;
        let buffers = SceneBuffers::new(&scene, &options)?;
        let mut entry =
            Entry { index: device.info.index, device: device.info.name.clone(), programs: Vec::new(), error: None };
        // A device that cannot build them must not hide the others.
        match kernel_resources(&device, &buffers, &options, args.depth.unwrap_or(DEFAULT_DEPTH), Looked::All) {
            Ok(programs) => entry.programs = programs,
            Err(error) => {
                entry.error = Some(super::chain(&error));
                errors.push(error);
            }
        }
        entries.push(entry);
    }
    if args.json {
        print::json(&entries);
    }
    for entry in &entries {
        for program in entry.programs.iter().filter(|program| talk.verbose && !program.log.is_empty()) {
            tell!("{}", program.log);
        }
        if !args.json && entry.error.is_none() {
            say!("{}", report(entry).trim_end());
        }
    }
    let last = errors.pop();
    for error in &errors {
        print::error(error);
    }
    last.map_or(Ok(()), Err)
}

/// The device that `spec` names, or every usable one.
fn devices(spec: Option<&str>) -> Result<Vec<DeviceHandle>> {
    if let Some(spec) = spec {
        return match select(Some(spec))? {
            Selection::OpenCl(device) => Ok(vec![device]),
            Selection::Reference { .. } => {
                Err(Error::NoDevice("the reference has no kernels; `raybrook devices` lists the devices".into()))
            }
        };
    }
    let devices: Vec<_> = list_devices()?.devices.into_iter().filter(|device| device.info.is_usable()).collect();
    if devices.is_empty() {
        return Err(Error::NoDevice(
            "there is no usable OpenCL device; `raybrook devices` tells what is missing".into(),
        ));
    }
    Ok(devices)
}

fn sphere() -> Result<Scene> {
    let mut builder = Builder::new();
    builder.sphere(1.0, SEGMENTS);
    let mut scene = builder.finish()?;
    complete(&mut scene, 1.0);
    Ok(scene)
}

/// A table of each program for people; `-` is what the driver does not tell.
fn report(entry: &Entry) -> String {
    let or_dash = |number: Option<u64>| number.map_or("-".to_owned(), |number| number.to_string());
    let mut text = wrapped(&format!("{:>4}  ", entry.index), &entry.device);
    for program in &entry.programs {
        let width = program.kernels.iter().map(|kernel| kernel.kernel.len()).max().unwrap_or(0);
        text += &wrapped("      ", &program.compile_options.replace("-D ", "-D"));
        text += &wrapped("      ", &format!("binary of {} bytes", or_dash(program.binary_bytes)));
        let _ = write!(text, "      {:width$}", "");
        for (heading, _) in COLUMNS {
            let _ = write!(text, "  {heading}");
        }
        for kernel in &program.kernels {
            let _ = write!(text, "\n      {:width$}", kernel.kernel);
            for (heading, number) in COLUMNS {
                let _ = write!(text, "  {:>1$}", or_dash(number(kernel)), heading.len());
            }
        }
        text += "\n";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_report_has_numbers_under_their_headings_and_dashes() {
        let render = KernelResources {
            kernel: "render".to_owned(),
            registers: Some(40),
            spill_store_bytes: None,
            spill_load_bytes: Some(0),
            stack_frame_bytes: Some(192),
            private_memory_bytes: None,
            local_memory_bytes: Some(1),
            max_work_group_size: Some(1024),
            preferred_work_group_multiple: Some(32),
        };
        let program = ProgramResources {
            compile_options: "-D TRAVERSE=traverse_kd_stack".to_owned(),
            binary_bytes: Some(1234),
            log: String::new(),
            kernels: vec![render],
        };
        let expected = "   3  Sample device
      -DTRAVERSE=traverse_kd_stack
      binary of 1234 bytes
              registers  spill stores  spill loads  frame  private  local  group  multiple
      render         40             -            0    192        -      1   1024        32
";
        let entry = Entry { index: 3, device: "Sample device".to_owned(), programs: vec![program], error: None };
        assert_eq!(report(&entry), expected);
    }
}
