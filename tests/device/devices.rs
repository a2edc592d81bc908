//! The device layer on the device of this computer: `RAYBROOK_DEVICE`, or the default. Without OpenCL the tests say
//! that they are skipped. Tests of an environment (no driver, no loader) run this binary again with other variables.

use raybrook::Error;
use raybrook::low_level::device::{
    Buffer, Built, Cache, CompileOptions, DeviceContext, DeviceHandle, DeviceKind, Kernel, KernelArg, Limits, Looked,
    ProgramSource, Selection, build, devices_json, devices_report, kernel_resources, list_devices, select,
};
use raybrook::low_level::options::{Intersector, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::scene::Builder;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Set in the processes that tests start; names what the child is to do.
const CHILD: &str = "RAYBROOK_TEST_CHILD";

const SCALE_CL: &str = "kernel void scale(global const float* from, global float* to, float factor, uint count) {
    const size_t i = get_global_id(0);
    if (i < count) to[i] = from[i] * factor + OFFSET;
}
kernel void is_null(global const float* maybe, global uint* answer) { *answer = maybe == 0 ? 1u : 2u; }
";

/// A device that no other test uses meanwhile: Oclgrind loses the work of several threads, and times are steadier.
struct OneAtATime(DeviceContext, #[allow(dead_code)] MutexGuard<'static, ()>);

impl std::ops::Deref for OneAtATime {
    type Target = DeviceContext;

    fn deref(&self) -> &DeviceContext {
        &self.0
    }
}

fn open_device() -> Option<OneAtATime> {
    static IN_USE: Mutex<()> = Mutex::new(());
    let guard = IN_USE.lock().unwrap_or_else(PoisonError::into_inner);
    Some(OneAtATime(open_device_unlocked()?, guard))
}

fn open_device_unlocked() -> Option<DeviceContext> {
    Some(DeviceContext::open(&select_device()?).expect("a listed device opens"))
}

fn select_device() -> Option<DeviceHandle> {
    let wanted = std::env::var("RAYBROOK_DEVICE").ok();
    match select(wanted.as_deref()).expect("the device that RAYBROOK_DEVICE names") {
        Selection::OpenCl(handle) => Some(handle),
        Selection::Reference { notice } => {
            crate::common::skip(notice.unwrap_or_default());
            None
        }
    }
}

fn build_scale(context: &DeviceContext, offset: &str, cache: Option<&Cache>) -> Built {
    let source = ProgramSource::new([("cl/scale.cl", SCALE_CL)]);
    build(context, &source, &CompileOptions::new().define("OFFSET", offset), cache).expect("the kernels build")
}

/// The numbers 0, 2, 4, … plus `offset`, computed on the device; one element after the end must stay as it was.
fn check_scale(context: &DeviceContext, built: &Built, offset: f32) {
    const COUNT: usize = 1000;
    const CANARY: f32 = -12345.0;
    let from: Vec<f32> = (0..COUNT).map(|i| i as f32).collect();
    let from = Buffer::from_slice(context, "from", &from).unwrap();
    let to = Buffer::read_write(context, "to", &[CANARY; COUNT + 1]).unwrap();
    let mut kernel = built.program.kernel("scale").unwrap();
    assert_eq!((kernel.name(), kernel.arg_count()), ("scale", 4));
    kernel.set_arg(0, &from).unwrap();
    kernel.set_arg(1, &to).unwrap();
    kernel.set_arg(2, 2.0_f32).unwrap();
    kernel.set_arg(3, COUNT as u32).unwrap();
    drop(from); // the kernel keeps it
    let seconds = kernel.launch(&[1024], Some(&[32])).unwrap().wait().unwrap();
    assert!((0.0..60.0).contains(&seconds), "{seconds}");
    let result = to.read().unwrap();
    for (i, &value) in result[..COUNT].iter().enumerate() {
        assert_eq!(value, 2.0 * i as f32 + offset);
    }
    assert_eq!(result[COUNT], CANARY);
    assert!(kernel.max_work_group_size().unwrap() >= 1 && kernel.preferred_work_group_multiple().unwrap() >= 1);
    kernel.private_memory_bytes().unwrap();
}

#[test]
fn the_list_is_sane() {
    let list = list_devices().unwrap();
    if list.devices.is_empty() {
        crate::common::skip(list.diagnosis.summary());
        assert!(!list.diagnosis.problems.is_empty());
        return;
    }
    for (index, info) in list.infos().enumerate() {
        assert_eq!(info.index, index);
        assert!(!info.name.is_empty() && !info.platform_name.is_empty() && !info.driver_version.is_empty(), "{info:?}");
        assert!(
            info.platform_version.starts_with("OpenCL ") && info.opencl_c_version.starts_with("OpenCL C "),
            "{info:?}"
        );
        assert!(info.compute_units > 0 && info.max_work_group_size > 0 && info.local_memory_bytes > 0, "{info:?}");
        assert!(info.max_alloc_bytes > 1 << 20 && info.max_alloc_bytes <= info.global_memory_bytes, "{info:?}");
        assert!(info.is_usable() && info.little_endian, "{info:?}");
        assert_eq!(info.images, info.image2d_max_width > 0, "{info:?}");
    }
    let report = devices_report(&list);
    let json: serde_json::Value = serde_json::from_str(&devices_json(&list)).unwrap();
    for (info, json) in list.infos().zip(json["devices"].as_array().unwrap()) {
        assert!(report.contains(&info.name), "{report}");
        assert_eq!(json["name"], info.name.as_str());
        assert_eq!(json["kind"], info.kind.name());
    }
}

#[test]
fn a_device_is_selected_by_index_name_or_kind() {
    let list = list_devices().unwrap();
    let Some(first) = list.infos().next() else { return crate::common::skip(list.diagnosis.summary()) };
    let selected = |spec: &str| match select(Some(spec)) {
        Ok(Selection::OpenCl(handle)) => handle.info.index,
        other => panic!("'{spec}' gives {other:?}"),
    };
    assert_eq!(selected("0"), 0);
    if list.devices.len() == 1 {
        assert_eq!(selected(&first.name.to_uppercase()), 0);
        assert_eq!(selected(&first.platform_name[..6]), 0);
    }
    for kind in [DeviceKind::Cpu, DeviceKind::Gpu] {
        if list.infos().any(|info| info.kind == kind) {
            assert_eq!(list.devices[selected(kind.name())].info.kind, kind);
        } else {
            assert!(matches!(select(Some(kind.name())), Err(Error::NoDevice(_))));
        }
    }
    assert!(matches!(select(None), Ok(Selection::OpenCl(_))));
    assert!(matches!(select(Some("reference")), Ok(Selection::Reference { notice: None })));
    let error = select(Some("nonsense")).unwrap_err();
    assert_eq!(error.exit_code(), 4);
    let message = error.to_string();
    assert!(
        message.contains("'nonsense'") && message.contains(&first.name) && message.contains("reference"),
        "{message}"
    );
}

#[test]
fn buffers_come_back_as_they_went() {
    let Some(context) = open_device() else { return };
    let numbers: Vec<u32> = (0..100_000).map(|i| i * 7919).collect();
    let buffer = Buffer::from_slice(&context, "numbers", &numbers).unwrap();
    assert_eq!(context.allocated_bytes(), 400_000);
    assert_eq!(buffer.read().unwrap(), numbers);
    let mut part = [0; 3];
    buffer.read_into(50_000, &mut part).unwrap();
    assert_eq!(part, numbers[50_000..50_003]);
    buffer.write(&[1, 2, 3]).unwrap();
    assert_eq!(buffer.read().unwrap()[..4], [1, 2, 3, numbers[3]]);

    for empty in
        [Buffer::<u32>::from_slice(&context, "nothing", &[]).unwrap(), Buffer::empty(&context, "nothing", 0).unwrap()]
    {
        assert!(empty.is_empty());
        assert!(empty.read().unwrap().is_empty());
        empty.write(&[]).unwrap();
    }
    drop(buffer);
    assert_eq!(context.allocated_bytes(), 0);
    context.finish().unwrap();
}

/// Parts of pinned memory have 4 MiB, and what is less than two of them does without.
#[test]
fn large_buffers_come_back_through_pinned_memory() {
    let Some(context) = open_device() else { return };
    context.stage_transfers();
    let part = 4 << 20;
    for bytes in [part, 2 * part, 2 * part + 4, 5 * part - 4, 5 * part] {
        let numbers: Vec<u32> = (0..bytes as u32 / 4).map(|i| i.wrapping_mul(0x9e37_79b9)).collect();
        let buffer = Buffer::from_slice(&context, "numbers", &numbers).unwrap();
        assert!(buffer.read().unwrap() == numbers, "{bytes} bytes");
        let opposite: Vec<u32> = numbers.iter().map(|number| !number).collect();
        assert!(buffer.read_as(|number: u32| !number).unwrap() == opposite, "{bytes} bytes");
        // The first parts anew, and nothing behind them.
        let again: Vec<u32> = numbers[..numbers.len() - 1].iter().rev().copied().collect();
        buffer.write(&again).unwrap();
        let found = buffer.read().unwrap();
        assert!(found[..again.len()] == again && found[again.len()..] == numbers[again.len()..], "{bytes} bytes");
    }
    // Elements of which no whole number fills a part.
    let triples: Vec<[f32; 3]> = (0..1_500_001).map(|i| [i as f32, -1.0, 0.5]).collect();
    assert!(Buffer::from_slice(&context, "triples", &triples).unwrap().read().unwrap() == triples);
    context.finish().unwrap();
}

#[test]
fn a_buffer_over_the_limit_is_an_error_that_names_it() {
    let Some(context) = open_device() else { return };
    let too_many = context.info().max_alloc_bytes as usize / 4 + 1;
    for len in [too_many, usize::MAX] {
        let message = Buffer::<u32>::empty(&context, "the kd-tree", len).unwrap_err().to_string();
        assert!(
            message.contains("the kd-tree needs ") && message.contains("CL_DEVICE_MAX_MEM_ALLOC_SIZE"),
            "{message}"
        );
    }
    assert_eq!(context.allocated_bytes(), 0);
}

#[test]
fn kernels_run_and_keep_inside_their_buffers() {
    let Some(context) = open_device() else { return };
    let built = build_scale(&context, "0.5f", None);
    assert!(!built.from_cache && built.notes.is_empty() && built.compile_s > 0.0);
    check_scale(&context, &built, 0.5);
}

#[test]
fn a_missing_buffer_is_a_null_pointer() {
    let Some(context) = open_device() else { return };
    let built = build_scale(&context, "0.0f", None);
    let mut kernel = built.program.kernel("is_null").unwrap();
    let answer = Buffer::read_write(&context, "answer", &[0_u32]).unwrap();
    kernel.set_arg(1, &answer).unwrap();
    for (argument, expected) in [(KernelArg::NULL, 1), (KernelArg::from(&answer), 2)] {
        kernel.set_arg(0, argument).unwrap();
        kernel.launch(&[1], None).unwrap().wait().unwrap();
        assert_eq!(answer.read().unwrap(), [expected]);
    }
}

#[test]
fn wrong_use_of_a_kernel_is_an_error_and_no_crash() {
    let Some(context) = open_device() else { return };
    let built = build_scale(&context, "0.0f", None);
    let message = |error: Error| error.to_string();
    assert!(
        message(built.program.kernel("scall").unwrap_err())
            .contains("clCreateKernel 'scall' failed: CL_INVALID_KERNEL_NAME")
    );
    let mut kernel = built.program.kernel("scale").unwrap();
    assert!(message(kernel.set_arg(4, 1.0_f32).unwrap_err()).contains("the kernel has 4 arguments"));
    assert!(message(kernel.launch(&[8], None).unwrap_err()).contains("argument 0 was never set"));
    let memory = Buffer::<f32>::empty(&context, "memory", 8).unwrap();
    kernel.set_arg(0, &memory).unwrap();
    kernel.set_arg(1, &memory).unwrap();
    kernel.set_arg(2, 1.0_f32).unwrap();
    kernel.set_arg(3, 8_u32).unwrap();
    assert_eq!(kernel.launch(&[0], None).unwrap().wait().unwrap(), 0.0);
    let too_large = context.info().max_work_group_size * 2;
    let error = message(kernel.launch(&[too_large], Some(&[too_large])).unwrap_err());
    assert!(error.contains("clEnqueueNDRangeKernel of 'scale'") && error.contains("CL_INVALID_WORK_"), "{error}");
    kernel.launch(&[8], Some(&[1])).unwrap().wait().unwrap();
}

#[test]
fn a_build_error_names_file_and_line() {
    let Some(context) = open_device() else { return };
    let bad = "// one\n// two\nkernel void broken(global float* x) { *x = undeclared_name; }\n";
    let source = ProgramSource::new([("cl/fine.cl", SCALE_CL), ("cl/broken.cl", bad)]);
    let Err(Error::Build { device, options, log }) =
        build(&context, &source, &CompileOptions::new().define("OFFSET", "0.0f"), None)
    else {
        panic!("broken source was built")
    };
    assert_eq!(device, context.info().name);
    assert!(options.starts_with("-cl-std=CL1.2") && options.contains("-D OFFSET=0.0f"), "{options}");
    println!("{log}");
    assert!(log.contains("cl/broken.cl:3:") && log.contains("undeclared_name"), "{log}");
}

#[test]
fn the_cache_is_used_and_a_damaged_file_is_not() {
    let Some(context) = open_device() else { return };
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::at(folder.path().join("programs"));
    let files = || -> Vec<PathBuf> { std::fs::read_dir(cache.folder()).unwrap().map(|e| e.unwrap().path()).collect() };

    let start = std::time::Instant::now();
    let first = build_scale(&context, "0.25f", Some(&cache));
    println!("built and stored in {:.4} s", start.elapsed().as_secs_f64());
    assert!(!first.from_cache && first.notes.is_empty(), "{:?}", first.notes);
    check_scale(&context, &first, 0.25);
    assert_eq!(files().len(), 1);
    context.forget_programs();
    let second = build_scale(&context, "0.25f", Some(&cache));
    println!("from source {:.4} s, from the cache {:.4} s", first.compile_s, second.compile_s);
    assert!(second.from_cache, "{:?}", second.notes);
    check_scale(&context, &second, 0.25);

    // Other options are another program.
    let other = build_scale(&context, "0.75f", Some(&cache));
    assert!(!other.from_cache);
    check_scale(&context, &other, 0.75);
    assert_eq!(files().len(), 2);

    for path in files() {
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    }
    context.forget_programs();
    let rebuilt = build_scale(&context, "0.25f", Some(&cache));
    assert!(
        !rebuilt.from_cache && rebuilt.notes.len() == 1 && rebuilt.notes[0].contains("damaged"),
        "{:?}",
        rebuilt.notes
    );
    check_scale(&context, &rebuilt, 0.25);
    context.forget_programs();
    assert!(build_scale(&context, "0.25f", Some(&cache)).from_cache);
}

#[test]
fn who_opens_the_same_device_shares_its_programs() {
    let Some(context) = open_device() else { return };
    let handle = select_device().expect("it was there");
    let first = DeviceContext::open(&handle).unwrap();
    first.forget_programs();
    let built = build_scale(&first, "0.125f", None);
    assert!(built.compile_s > 0.0);
    let second = DeviceContext::open(&select_device().expect("it was there")).unwrap();
    let shared = build_scale(&second, "0.125f", None);
    assert_eq!((shared.compile_s, shared.log == built.log), (0.0, true));
    // Its kernels and its queue are its own, and it has them when the first is gone.
    drop((first, built));
    check_scale(&second, &shared, 0.125);
    assert_eq!(second.allocated_bytes(), 0);
    assert_eq!(build_scale(&context, "0.125f", None).compile_s, 0.0);
    // Other options are compiled for, and a device after a failure.
    assert!(build_scale(&second, "0.375f", None).compile_s > 0.0);
    assert!(shared.program.kernel("no such kernel").is_err());
    let after = DeviceContext::open(&handle).unwrap();
    assert!(build_scale(&after, "0.125f", None).compile_s > 0.0);
    second.forget_programs();
    assert!(build_scale(&second, "0.125f", None).compile_s > 0.0);
}

#[test]
fn a_cache_that_cannot_be_written_is_only_a_note() {
    let Some(context) = open_device() else { return };
    let file = tempfile::NamedTempFile::new().unwrap();
    let built = build_scale(&context, "1.0f", Some(&Cache::at(file.path().join("below a file"))));
    assert!(built.notes.len() == 1 && built.notes[0].contains("not cached: cannot write"), "{:?}", built.notes);
    check_scale(&context, &built, 1.0);
}

#[test]
fn several_threads_use_a_device_of_their_own() {
    let Some(context) = open_device() else { return };
    if context.info().platform_name == "Oclgrind" {
        return crate::common::skip("Oclgrind loses the work of several threads");
    }
    std::thread::scope(|scope| {
        for number in 0..8 {
            scope.spawn(move || {
                let context = open_device_unlocked().unwrap();
                let offset = number as f32;
                check_scale(&context, &build_scale(&context, &format!("{offset:.1}f"), None), offset);
            });
        }
    });
}

/// Runs the child test below with `variables` and returns what it printed.
fn child(what: &str, variables: &[(&str, &Path)]) -> String {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args(["--exact", "devices::child_process", "--nocapture", "--test-threads=1"])
        .env(CHILD, what)
        .env_remove("RAYBROOK_DEVICE");
    let output = command.envs(variables.iter().copied()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    text
}

/// Not a test by itself: what the processes of [`child`] do.
#[test]
fn child_process() {
    match std::env::var(CHILD).as_deref() {
        Ok("report") => {
            println!("{}", devices_report(&list_devices().unwrap()));
            match select(None).unwrap() {
                Selection::Reference { notice } => println!("notice: {}", notice.unwrap()),
                Selection::OpenCl(handle) => println!("device: {}", handle.info.name),
            }
            if let Err(error) = select(Some("gpu")) {
                println!("gpu: {error}");
            }
        }
        Ok("refused binary") => {
            let context = open_device().unwrap();
            let folder = tempfile::tempdir().unwrap();
            let cache = Cache::at(folder.path());
            check_scale(&context, &build_scale(&context, "2.0f", Some(&cache)), 2.0);
            context.forget_programs();
            let again = build_scale(&context, "2.0f", Some(&cache));
            println!("from_cache {} notes {:?}", again.from_cache, again.notes);
            check_scale(&context, &again, 2.0);
        }
        _ => {}
    }
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_driver_the_diagnosis_says_so() {
    let vendors = tempfile::tempdir().unwrap();
    let text = child("report", &[("OCL_ICD_VENDORS", vendors.path())]);
    println!("{text}");
    if text.contains("the OpenCL loader") {
        return crate::common::skip("there is no loader either");
    }
    assert!(text.contains("No OpenCL device."), "{text}");
    assert!(text.contains(&format!(
        "no .icd file in '{}', which the variable OCL_ICD_VENDORS names",
        vendors.path().display()
    )));
    assert!(text.contains(
        // What follows depends on the computer: a GPU that nothing drives is named first.
        "notice: tracing with the slow scalar reference, as there is no usable OpenCL device: "
    ));
    assert!(text.contains("apt-get install pocl-opencl-icd"), "{text}");
    assert!(text.contains("gpu: no gpu offers OpenCL; there is no OpenCL device"), "{text}");
}

#[test]
#[cfg(target_os = "linux")]
fn a_driver_without_its_library_is_named() {
    let vendors = tempfile::tempdir().unwrap();
    std::fs::write(vendors.path().join("gone.icd"), "libgone.so.1\n").unwrap();
    let text = child("report", &[("OCL_ICD_VENDORS", vendors.path())]);
    println!("{text}");
    assert!(
        text.contains("the OpenCL loader")
            || text.contains("gone.icd' names the library 'libgone.so.1', which is not there")
    );
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_loader_the_diagnosis_says_so() {
    // A file that is no library: the linker finds it first and refuses it.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("libOpenCL.so.1"), "").unwrap();
    let text = child("report", &[("LD_LIBRARY_PATH", folder.path()), ("OPENCL_DYLIB_PATH", folder.path())]);
    println!("{text}");
    assert!(text.contains("the OpenCL loader libOpenCL.so.1 was not found or does not load"), "{text}");
    assert!(text.contains("apt-get install ocl-icd-libopencl1"), "{text}");
}

/// Oclgrind takes no part in the other tests; its binaries load again or are rebuilt, but never stop a run.
#[test]
#[cfg(target_os = "linux")]
fn oclgrind_builds_whether_its_binaries_load_or_not() {
    const LIBRARY: &str = "/usr/lib/oclgrind/liboclgrind-rt-icd.so";
    if !Path::new(LIBRARY).exists() {
        return crate::common::skip("oclgrind is not installed");
    }
    let vendors = tempfile::tempdir().unwrap();
    std::fs::write(vendors.path().join("oclgrind.icd"), LIBRARY).unwrap();
    println!("{}", child("report", &[("OCL_ICD_VENDORS", vendors.path())]));
    let text = child("refused binary", &[("OCL_ICD_VENDORS", vendors.path())]);
    println!("{text}");
    assert!(text.contains("from_cache true") || text.contains("driver refused the binary"), "{text}");
}

#[test]
fn every_kernel_of_the_program_has_its_work_group_limits() {
    let wanted = std::env::var("RAYBROOK_DEVICE").ok();
    let Ok(Selection::OpenCl(device)) = select(wanted.as_deref()) else { return crate::common::skip("no device") };
    let _one_at_a_time = open_device();
    let mut builder = Builder::new();
    builder.sphere(1.0, 16);
    let options = TraceOptions { intersector: Intersector::Precomputed, ..TraceOptions::DEFAULT };
    let buffers = SceneBuffers::new(&builder.finish().unwrap(), &options).unwrap();
    let programs = kernel_resources(&device, &buffers, &options, 3, Looked::All).unwrap();
    for program in &programs {
        assert!(program.compile_options.contains("-D INTERSECT=intersect_precomputed"), "{}", program.compile_options);
        // Of the pictures of this scene, which has no glass: one ray waits at a time.
        let is_of_pictures = program.kernels.iter().any(|kernel| kernel.kernel == "render");
        assert_eq!(program.compile_options.contains("-D MAX_PENDING=1"), is_of_pictures, "{}", program.compile_options);
        assert!(program.binary_bytes.is_none_or(|bytes| bytes > 1000), "{:?}", program.binary_bytes);
    }
    let kernels: Vec<_> = programs.iter().flat_map(|program| &program.kernels).collect();
    let names: Vec<_> = kernels.iter().map(|kernel| kernel.kernel.as_str()).collect();
    assert_eq!(names, ["trace_any", "trace_closest", "trace_next", "render"]);
    for kernel in kernels {
        let limit = kernel.max_work_group_size.expect("every driver tells");
        assert!((1..=device.info.max_work_group_size as u64).contains(&limit), "{kernel:?}");
        let multiple = kernel.preferred_work_group_multiple.expect("every driver tells");
        assert!((1..=limit).contains(&multiple), "{kernel:?}");
        // Only NVIDIA's compiler tells of registers, and then of everything.
        assert_eq!(kernel.registers.is_some(), device.info.nvidia_options, "{kernel:?}");
        assert_eq!(kernel.stack_frame_bytes.is_some(), kernel.registers.is_some(), "{kernel:?}");
        assert_eq!(kernel.spill_load_bytes.is_some(), kernel.registers.is_some(), "{kernel:?}");
    }
}

#[test]
fn kernels_that_measure_limits_do_the_work_that_is_counted() {
    let Some(context) = open_device() else { return };
    let program = build(&context, &ProgramSource::limits(), &CompileOptions::new(), None).unwrap().program;
    let launch = |kernel: &Kernel, items: usize| kernel.launch(&[items], None).unwrap().wait().unwrap();

    let sums = Buffer::<[f32; 16]>::empty(&context, "sums", 3).unwrap();
    let mut arithmetic = program.kernel("arithmetic").unwrap();
    arithmetic.set_arg(0, 5_u32).unwrap();
    arithmetic.set_arg(1, 0.5_f32).unwrap();
    arithmetic.set_arg(2, 1.0_f32).unwrap();
    arithmetic.set_arg(3, &sums).unwrap();
    launch(&arithmetic, 3);
    let expected = |i: usize| {
        let [a, b, c, d] = [0.0, 1.0, 2.0, 3.0].map(|first| (0..5).fold(i as f32 + first, |x, _| x * 0.5 + 1.0));
        [(a + b) + (c + d); 16]
    };
    assert_eq!(sums.read().unwrap(), [0, 1, 2].map(expected));

    let elements: Vec<f32> = (0..32).map(|i| i as f32).collect();
    let elements = Buffer::from_slice(&context, "elements", &elements).unwrap();
    let sums = Buffer::<[f32; 4]>::empty(&context, "sums", 2).unwrap();
    let mut reads = program.kernel("cached_reads").unwrap();
    reads.set_arg(0, 3_u32).unwrap();
    reads.set_arg(1, 8_u32).unwrap();
    reads.set_arg(2, &elements).unwrap();
    reads.set_arg(3, &sums).unwrap();
    launch(&reads, 2);
    // Of eight elements 0, 1, 2, 3; 4, 5, 6, 7; ... three times.
    assert_eq!(sums.read().unwrap(), [[336.0, 360.0, 384.0, 408.0]; 2]);

    let copied = Buffer::<f32>::empty(&context, "the copy", 32).unwrap();
    let mut copy = program.kernel("copy").unwrap();
    copy.set_arg(0, &elements).unwrap();
    copy.set_arg(1, &copied).unwrap();
    launch(&copy, 8);
    assert_eq!(copied.read().unwrap(), elements.read().unwrap());
}

/// Measurements of limits, of which one must be undisturbed.
const ATTEMPTS: u32 = 5;

#[test]
fn limits_are_measured() {
    let Some(_one_at_a_time) = open_device() else { return };
    let wanted = std::env::var("RAYBROOK_DEVICE").ok();
    let Ok(Selection::OpenCl(handle)) = select(wanted.as_deref()) else { panic!("it was there") };
    // Tests beside this one take turns with it on the same cores: a rate that they halve is measured again.
    let cache_is_faster = (0..ATTEMPTS).any(|_| {
        let Limits { flops, cached_bytes, memory_bytes } = Limits::measure(&handle, None).unwrap();
        // Any device since 2000, and none before 2100.
        for rate in [flops, cached_bytes, memory_bytes] {
            assert!((1e8..1e18).contains(&rate), "{rate}");
        }
        cached_bytes > memory_bytes
    });
    assert!(cache_is_faster, "in {ATTEMPTS} measurements");
}
