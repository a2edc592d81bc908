//! The program on a device that fails: a library in place of OpenCL's (`faults/opencl_faults.rs`) spoils calls.
//! Whatever it spoils, a run ends by itself with the undisturbed run's bits, or with code 4 and one sentence that names
//! a call. What the long sweep showed is in `faults/README.md`.
#![cfg(target_os = "linux")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// No run takes longer, on however busy a machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// Codes of drivers that fail: no memory, no resources, no device, no build, no times, lost as NVIDIA's driver says it.
const CODES: [i32; 6] = [-4, -5, -2, -11, -7, -9999];

/// The smallest kernels: they compile in a moment.
const SMALL: &[&str] = &["--structure", "brute", "--intersector", "moller-trumbore", "--packet-size", "1"];

/// What is run: the arguments, the files that it writes.
struct Case {
    name: &'static str,
    arguments: Vec<&'static str>,
    files: &'static [&'static str],
}

impl Case {
    fn new(name: &'static str, arguments: &str, files: &'static [&'static str]) -> Case {
        let arguments = arguments.to_owned().leak().split_whitespace().collect();
        Case { name, arguments, files }
    }

    fn render() -> Case {
        let arguments = "render one.obj -o a.pfm --size 9x7 --samples 1 --stats s.json";
        let mut case = Case::new("render", arguments, &["a.pfm"]);
        case.arguments.extend(SMALL);
        case
    }

    fn all() -> Vec<Case> {
        vec![
            Case::new("render", "render one.obj -o a.pfm --size 9x7 --samples 1", &["a.pfm"]),
            Case::new("render, by error", "render one.obj -o a.pfm --size 16x16 --error 2", &["a.pfm"]),
            Case::new(
                "render, wavefront",
                "render one.obj -o a.pfm --size 9x7 --samples 1 --kernels wavefront",
                &["a.pfm"],
            ),
            Case::new("trace", "trace one.obj rays.npz -o h.npz", &["h.npz"]),
            Case::new("check", "check one.obj -o d.png --size 9x7 --samples 1", &["d.png"]),
            Case::new("tune", "tune one.obj --rays 16 --structure bvh2", &[]),
        ]
    }
}

/// How a run ended.
struct Ended {
    output: Output,
    hung: bool,
    files: Vec<Option<Vec<u8>>>,
    /// The names of the calls, and of those that were spoilt.
    calls: Vec<String>,
    spoilt: Vec<String>,
}

impl Ended {
    fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
    }

    /// The sentences that say why the program failed.
    fn errors(&self) -> Vec<String> {
        self.stderr().lines().filter(|line| line.starts_with("raybrook: ")).map(str::to_owned).collect()
    }
}

/// The library that spoils calls, compiled once.
fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let source = crate::common::root().join("tests/faults/opencl_faults.rs");
        let library = Path::new(env!("CARGO_TARGET_TMPDIR")).join("libopencl_faults.so");
        let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
        rustc.args(["--edition", "2024", "--crate-type", "cdylib", "-o"]).args([&library, &source]);
        assert!(rustc.status().unwrap().success());
        library
    })
}

/// A folder with a scene and a batch of rays.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("one.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let mut rays = zip::ZipWriter::new(std::fs::File::create(folder.path().join("rays.npz")).unwrap());
    for (name, row) in [("origin.npy", [0.2_f32, 0.3, 5.0]), ("direction.npy", [0.0, 0.0, -1.0])] {
        rays.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        let shape = "{'descr': '<f4', 'fortran_order': False, 'shape': (20, 3), }";
        let header = format!("{shape:117}\n");
        let values: Vec<u8> = row.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<_>>().repeat(20);
        let bytes = [&b"\x93NUMPY\x01\x00v\x00"[..], header.as_bytes(), &values].concat();
        std::io::Write::write_all(&mut rays, &bytes).unwrap();
    }
    rays.finish().unwrap();
    folder
}

/// Runs a case while the library spoils what `fault` says, on the CPU unless another device is named; empty `variables`
/// are removed.
fn run(case: &Case, fault: &str, variables: &[(&str, &str)]) -> Ended {
    let folder = folder();
    let at = folder.path();
    let device = std::env::var("RAYBROOK_DEVICE").ok().filter(|name| !name.is_empty());
    let mut command = Command::new(env!("CARGO_BIN_EXE_raybrook"));
    command
        .args(&case.arguments)
        .current_dir(at)
        .env("RAYBROOK_CACHE_DIR", at.join("cache"))
        .env("RAYBROOK_DEVICE", device.unwrap_or_else(|| "cpu".to_owned()))
        .env("OPENCL_DYLIB_PATH", library())
        .env("OPENCL_FAULT", fault)
        .env("OPENCL_FAULT_LOG", at.join("log"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    for &(name, value) in variables {
        match value {
            "" => command.env_remove(name),
            _ => command.env(name, value),
        };
    }
    let mut child = command.spawn().unwrap();
    let start = Instant::now();
    let mut hung = false;
    // What a run prints fits into a pipe.
    while child.try_wait().unwrap().is_none() {
        hung = start.elapsed() > PATIENCE;
        if hung {
            child.kill().unwrap();
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let log = std::fs::read_to_string(at.join("log")).unwrap_or_default();
    Ended {
        output: child.wait_with_output().unwrap(),
        hung,
        files: case.files.iter().map(|file| std::fs::read(at.join(file)).ok()).collect(),
        calls: log.lines().map(|line| line.trim_end_matches(" spoilt").to_owned()).collect(),
        spoilt: log.lines().filter_map(|line| Some(line.strip_suffix(" spoilt")?.to_owned())).collect(),
    }
}

/// What is wrong with how a run ended, if anything is.
fn judge(ended: &Ended, undisturbed: &Ended) -> Result<(), String> {
    let (code, errors) = (ended.output.status.code(), ended.errors());
    let names_a_call = errors.iter().all(|error| ended.spoilt.iter().any(|name| error.contains(name.as_str())));
    let wrong = match code {
        _ if ended.hung => "hangs",
        None => "ends by a signal",
        _ if ended.stderr().contains("panicked") => "panics",
        Some(0) if ended.files != undisturbed.files => "wrong bits",
        Some(0) => return Ok(()),
        Some(4) if errors.len() != 1 => "not one sentence",
        Some(4) if !names_a_call => "no sentence that names the call",
        Some(4) => return Ok(()),
        Some(_) => "wrong code",
    };
    Err(format!("{wrong}: {:?}: {}", ended.output.status, ended.stderr()))
}

/// The undisturbed run; `None`, with the reason printed, where there is no device.
fn undisturbed(case: &Case) -> Option<Ended> {
    let ended = run(case, "", &[]);
    if ended.output.status.success() {
        assert!(ended.files.iter().all(Option::is_some));
        return Some(ended);
    }
    assert!(std::env::var_os("RAYBROOK_REQUIRE_DEVICE").is_none(), "{}", ended.stderr());
    crate::common::skip(format_args!("no device: {}", ended.stderr()));
    None
}

/// The undisturbed run of the small picture: once, because PoCL 3.1 may abort where processes fill an empty cache of
/// kernels at once.
fn small_picture() -> Option<&'static Ended> {
    static PICTURE: OnceLock<Option<Ended>> = OnceLock::new();
    PICTURE.get_or_init(|| undisturbed(&Case::render())).as_ref()
}

/// Held by tests whose runs compile other kernels, for the same reason.
static COMPILES: Mutex<()> = Mutex::new(());

/// Judges runs of several faults, several at a time; what was wrong with which.
fn judge_all(case: &Case, undisturbed: &Ended, faults: &[String]) -> Vec<String> {
    let workers = std::thread::available_parallelism().map_or(1, |count| count.get());
    let share = faults.len().div_ceil(workers).max(1);
    std::thread::scope(|scope| {
        let judge_some = |some: &[String]| -> Vec<String> {
            let judged = some.iter().map(|fault| (fault, judge(&run(case, fault, &[]), undisturbed)));
            judged.filter_map(|(fault, judged)| Some(format!("{}, {fault}: {}", case.name, judged.err()?))).collect()
        };
        let threads: Vec<_> = faults.chunks(share).map(|some| scope.spawn(move || judge_some(some))).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    })
}

#[test]
fn every_kind_of_call_may_fail_once_or_for_ever() {
    let case = Case::render();
    let Some(undisturbed) = small_picture() else { return };
    // The last call of each name: those before it have made what is to be released.
    let last: BTreeMap<&str, usize> =
        undisturbed.calls.iter().enumerate().map(|(i, name)| (name.as_str(), i + 1)).collect();
    assert!(last.contains_key("clReleaseContext") && last.len() >= 24, "{last:?}");
    let faults: Vec<String> = last
        .values()
        .enumerate()
        .flat_map(|(i, number)| {
            [format!("only:{number}:{}", CODES[i % 6]), format!("from:{number}:{}", CODES[(i + 2) % 6])]
        })
        .collect();
    let wrong = judge_all(&case, undisturbed, &faults);
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), faults.len(), wrong.join("\n"));
}

/// The last calls of these names: those before may belong to the opening of the device.
fn last_of<'n>(undisturbed: &Ended, names: &'n [&'n str]) -> impl Iterator<Item = (&'n str, usize)> {
    let last = |name: &str| undisturbed.calls.iter().rposition(|call| call == name).map(|i| i + 1);
    names
        .iter()
        .map(move |&name| (name, last(name)))
        .filter_map(|(name, last)| Some((name, last?)))
        .collect::<Vec<_>>()
        .into_iter()
}

#[test]
fn the_reference_goes_on_where_a_device_is_lost() {
    let Some(_) = small_picture() else { return };
    let _lock = COMPILES.lock().unwrap_or_else(PoisonError::into_inner);
    // Scenes without light have a lamp that goes with the camera: the reference must know where it is.
    let turntable = "turntable one.obj --frames 3 --size 9x7 --samples 1 -o t.pfm";
    let cases = [
        Case::render(),
        Case::new("trace", "trace one.obj rays.npz -o h.npz --stats s.json", &["h.npz"]),
        Case::new("turntable", turntable, &["t-0001.pfm", "t-0002.pfm", "t-0003.pfm"]),
    ];
    for mut case in cases {
        if !case.arguments.contains(&"brute") {
            case.arguments.extend(SMALL);
        }
        let Some(undisturbed) = undisturbed(&case) else { return };
        for (name, number) in last_of(&undisturbed, &["clEnqueueNDRangeKernel", "clEnqueueReadBuffer", "clFlush"]) {
            let fault = format!("from:{number}:-36");
            let ended = run(&case, &fault, &[]);
            let said = ended.stderr();
            assert!(ended.output.status.success() && ended.files == undisturbed.files, "{} {name}: {said}", case.name);
            assert!(said.contains("note: the reference goes on in place of") && said.contains(name), "{said}");
            case.arguments.push("--strict-device");
            let ended = run(&case, &fault, &[]);
            case.arguments.pop();
            let (errors, said) = (ended.errors(), ended.stderr());
            assert!(ended.output.status.code() == Some(4) && errors.len() == 1, "{} {name}: {said}", case.name);
            assert!(errors[0].contains(name) && !said.contains("goes on"), "{said}");
        }
    }
}

#[test]
fn the_reference_goes_on_where_all_of_several_devices_are_lost() {
    let Some(undisturbed) = small_picture() else { return };
    let _lock = COMPILES.lock().unwrap_or_else(PoisonError::into_inner);
    let mut case = Case::render();
    case.arguments.extend(["--device", "all"]);
    let fault = "from:clEnqueueNDRangeKernel:-36";
    let ended = run(&case, fault, &[("POCL_DEVICES", "pthread basic")]);
    let said = ended.stderr();
    assert!(ended.output.status.success() && ended.files == undisturbed.files, "{said}");
    assert!(said.contains("note: the other devices go on without") && said.contains("clEnqueueNDRange"), "{said}");
    assert!(said.contains("note: the reference goes on in place of"), "{said}");
    case.arguments.push("--strict-device");
    let ended = run(&case, fault, &[("POCL_DEVICES", "pthread basic")]);
    let (errors, said) = (ended.errors(), ended.stderr());
    assert!(ended.output.status.code() == Some(4) && errors.len() == 1, "{said}");
    assert!(errors[0].contains("clEnqueueNDRange") && !said.contains("go on"), "{said}");
}

#[test]
fn a_call_that_hangs_ends_the_program() {
    let case = Case::render();
    let Some(_) = small_picture() else { return };
    std::thread::scope(|scope| {
        for name in ["clBuildProgram", "clWaitForEvents", "clReleaseProgram", "clGetDeviceIDs"] {
            let case = &case;
            scope.spawn(move || {
                let ended = run(case, &format!("hang:{name}"), &[("RAYBROOK_DRIVER_LIMIT", "3")]);
                let (errors, said) = (ended.errors(), ended.stderr());
                assert!(ended.output.status.code() == Some(4) && errors.len() == 1, "{name}: {said}");
                assert!(errors[0].contains(name) && errors[0].contains("did not return in 3 s"), "{said}");
                assert!(said.contains("note: ") && said.contains("has not returned for"), "{said}");
            });
        }
    });
}

#[test]
fn a_driver_that_throws_ends_the_program() {
    let case = Case::render();
    let Some(_) = small_picture() else { return };
    for name in ["clBuildProgram", "clEnqueueNDRangeKernel", "clWaitForEvents"] {
        let ended = run(&case, &format!("throw:{name}"), &[]);
        let (errors, said) = (ended.errors(), ended.stderr());
        assert!(ended.output.status.code() == Some(4) && errors.len() == 1, "{name}: {said}");
        assert!(errors[0].contains(name) && errors[0].contains("threw an exception"), "{said}");
    }
}

#[test]
fn a_picture_needs_no_times() {
    let case = Case::render();
    let Some(undisturbed) = small_picture() else { return };
    let _lock = COMPILES.lock().unwrap_or_else(PoisonError::into_inner);
    for fault in ["from:clGetEventProfilingInfo:-7", "no-profiling"] {
        let ended = run(&case, fault, &[]);
        judge(&ended, undisturbed).unwrap();
        let said = ended.stderr();
        assert!(ended.output.status.success() && said.contains("does not time its commands"), "{fault}: {said}");
        let tuned = run(&Case::new("tune", "tune one.obj --rays 16 --structure brute", &[]), fault, &[]);
        let errors = tuned.errors();
        assert!(tuned.output.status.code() == Some(4) && errors.len() == 1, "{}", tuned.stderr());
        assert!(errors[0].contains("nothing can be measured on it"), "{errors:?}");
    }
}

#[test]
fn a_device_without_images_is_a_device_that_fails() {
    let Some(_) = small_picture() else { return };
    let _lock = COMPILES.lock().unwrap_or_else(PoisonError::into_inner);
    for memory in ["image2d", "buffer-image"] {
        let mut case = Case::render();
        case.arguments.extend(["--memory", memory]);
        let ended = run(&case, "no-images", &[]);
        assert!(ended.output.status.code() == Some(4), "{}", ended.stderr());
        assert!(ended.errors().len() == 1 && ended.errors()[0].contains("has no images"), "{}", ended.stderr());
    }
}

#[test]
fn where_no_device_is_named_the_next_one_is_taken() {
    let case = Case::render();
    let Some(undisturbed) = small_picture() else { return };
    let fault = "from:clCreateContext:-6";
    let unnamed = [("RAYBROOK_DEVICE", "")];
    let named = run(&case, fault, &[]);
    assert!(
        named.output.status.code() == Some(4) && named.errors()[0].contains("clCreateContext"),
        "{}",
        named.stderr()
    );
    let ended = run(&case, fault, &unnamed);
    let said = ended.stderr();
    assert!(ended.output.status.success() && ended.files == undisturbed.files, "{said}");
    assert!(said.contains("note: the next best device is taken") && said.contains("clCreateContext failed"), "{said}");
    assert!(said.contains("note: tracing with the slow scalar reference"), "{said}");
}

/// Every call of every case, once and from then on, with each code in turn. `OPENCL_FAULT_STRIDE` leaves out all but
/// every so manieth.
#[test]
#[ignore = "takes long: `cargo test --release --test device_faults -- --ignored --nocapture`"]
fn every_call_of_every_command() {
    let stride = std::env::var("OPENCL_FAULT_STRIDE").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let mut wrong = Vec::new();
    println!("| command | calls | kind | runs | failures |\n|---|---|---|---|---|");
    for case in Case::all() {
        let Some(undisturbed) = undisturbed(&case) else { return };
        let calls = undisturbed.calls.len();
        for kind in ["only", "from"] {
            let numbers = (1..=calls).step_by(stride);
            let faults: Vec<_> =
                numbers.map(|number| format!("{kind}:{number}:{}", CODES[number / stride % 6])).collect();
            let failures = judge_all(&case, &undisturbed, &faults);
            println!("| {} | {calls} | {kind} | {} | {} |", case.name, faults.len(), failures.len());
            wrong.extend(failures);
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
