//! What several test files need: a device, deterministic random numbers, small scenes, and the shared models.
#![allow(dead_code)] // every test file uses another part

pub mod models;
pub mod ply;
pub mod probe;

use glam::Vec3;
use raybrook::Result;
use raybrook::low_level::choose::Request;
use raybrook::low_level::device::{DeviceContext, DeviceHandle, Selection, select};
use raybrook::low_level::options::TraceOptions;
pub use raybrook::low_level::random::Random;
use raybrook::low_level::scene::{Material, NO_INDEX, Scene, Triangle};
use std::fmt::Display;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Seed of every random sequence; printed by the tests that fail.
pub const SEED: u64 = 20_081_121;

/// Says that a test, or a part of it, is skipped: past `eprintln!`, of which nobody sees what tests print that pass.
/// `./test` repeats these lines at its end.
pub fn skip(why: impl Display) {
    let why = why.to_string();
    let test = std::thread::current().name().map(|test| format!(" ({test})")).unwrap_or_default();
    let line = format!("SKIPPED, {}{test}\n", why.lines().next().unwrap_or_default());
    std::io::stderr().write_all(line.as_bytes()).expect("standard error takes a line");
}

/// The device to test on: `RAYBROOK_DEVICE`, else a CPU. `None`, with the reason printed, when there is none; where
/// `RAYBROOK_REQUIRE_DEVICE` is set that is a failure.
pub fn device() -> Option<DeviceHandle> {
    static DEVICE: OnceLock<Option<(DeviceHandle, Option<DeviceContext>)>> = OnceLock::new();
    // Held open, so that all tests of a program share what is compiled. Why it does not open a test will tell.
    let open = || choose_device().map(|device| (device.clone(), DeviceContext::open(&device).ok()));
    DEVICE.get_or_init(open).as_ref().map(|(device, _)| device.clone())
}

/// The device, for tests that compile many kernels and trace few rays with each: kernels that its compiler does not
/// optimise in a usual run, as users have them in a thorough one.
pub fn quick_device() -> Option<DeviceHandle> {
    device().map(|device| if is_thorough() { device } else { unoptimised(&device) })
}

/// The same device with kernels that its compiler does not optimise (OpenCL 1.2, section 5.6.4.4): PoCL compiles them
/// in little more than half of the time, and they must not differ in a bit. For tests that compile one kernel after the
/// other, beside some that are optimised.
pub fn unoptimised(device: &DeviceHandle) -> DeviceHandle {
    device.clone().with_compiler_options("-cl-opt-disable").unwrap()
}

/// Whether to compare everything that there is, as `./test --thorough` does (`RAYBROOK_THOROUGH=1`), instead of one of
/// each kind: programs take a second and more to compile, of which a usual run has some minutes' worth.
pub fn is_thorough() -> bool {
    std::env::var_os("RAYBROOK_THOROUGH").is_some_and(|value| !value.is_empty() && value != "0")
}

/// `all`, or where a usual run is to be short every `step`th of them, the first among them.
pub fn usually_every<T>(step: usize, all: impl IntoIterator<Item = T>) -> impl Iterator<Item = T> {
    all.into_iter().enumerate().filter(move |&(number, _)| is_usually_taken(step, number)).map(|(_, one)| one)
}

/// Whether a usual run takes the one with this number, when it takes one in `step`.
pub fn is_usually_taken(step: usize, number: usize) -> bool {
    is_thorough() || number.is_multiple_of(step)
}

/// Whether the device is Oclgrind, which interprets kernels: tests trace fewer rays there.
pub fn on_oclgrind() -> bool {
    device().is_some_and(|device| device.info.name.contains("Oclgrind"))
}

fn choose_device() -> Option<DeviceHandle> {
    let spec = std::env::var("RAYBROOK_DEVICE").ok();
    let reason = match select(Some(spec.as_deref().unwrap_or("cpu"))) {
        Ok(Selection::OpenCl(device)) => return Some(device),
        Ok(_) => "no OpenCL device chosen".to_owned(),
        Err(error) => error.to_string(),
    };
    assert!(std::env::var_os("RAYBROOK_REQUIRE_DEVICE").is_none(), "{reason}");
    skip(format_args!("no device: {reason}"));
    None
}

/// The folder of the project.
pub fn root() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let is_root = |folder: &&Path| folder.join("cl").is_dir();
    package.ancestors().find(is_root).expect("a package of the project").to_path_buf()
}

/// Does with an input of a fuzz target what must be done, and tells whether it could be used.
type Check = fn(&[u8]) -> bool;

/// Tries the inputs of fuzz targets that are kept in `fuzz/seeds`. The name of one that cannot be used begins with
/// `refused-`.
pub fn assert_kept_inputs_hold(targets: &[(&str, Check)]) {
    for (target, check) in targets {
        let seeds = root().join("fuzz/seeds").join(target);
        let mut inputs: Vec<_> = std::fs::read_dir(seeds).unwrap().map(|file| file.unwrap()).collect();
        inputs.sort_by_key(|input| input.file_name());
        assert!(!inputs.is_empty(), "{target} has no inputs");
        for input in inputs {
            let name = input.file_name().into_string().unwrap();
            println!("{target}: {name}");
            let is_used = check(&std::fs::read(input.path()).unwrap());
            assert_eq!(is_used, !name.starts_with("refused-"), "{target}: {name}");
        }
    }
}

/// A path under the shared models, which lie in `RAYBROOK_SHARED` or else beside the project; `None`, with the reason
/// printed, where they are not. Where `RAYBROOK_REQUIRE_SHARED` is set that is a failure.
pub fn shared(path: &str) -> Option<PathBuf> {
    let beside = || root().join("../shared");
    let path = std::env::var_os("RAYBROOK_SHARED").map_or_else(beside, PathBuf::from).join(path);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var_os("RAYBROOK_REQUIRE_SHARED").is_none(), "there is no {}", path.display());
    skip(format_args!("there is no {}", path.display()));
    None
}

/// What a text such as `structure=grid grid_size=4,4,4` asks for.
pub fn try_asked(text: &str) -> Result<TraceOptions> {
    let mut request = Request::default();
    for (name, value) in text.split_whitespace().filter_map(|word| word.split_once('=')) {
        request.set(name, value)?;
    }
    request.with_structure(TraceOptions::DEFAULT.kind())
}

/// The same of a text that asks for what there is.
pub fn asked(text: &str) -> TraceOptions {
    try_asked(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// A scene of the given triangles and one matt material.
pub fn scene_of(triangles: &[[Vec3; 3]]) -> Scene {
    Scene {
        positions: triangles.iter().flatten().copied().collect(),
        triangles: (0..triangles.len() as u32)
            .map(|i| Triangle {
                positions: [3 * i, 3 * i + 1, 3 * i + 2],
                normals: [NO_INDEX; 3],
                uvs: [NO_INDEX; 3],
                material: 0,
            })
            .collect(),
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

/// `count` random triangles of about `size` in the cube -1..1.
pub fn soup(count: usize, size: f32, random: &mut Random) -> Vec<[Vec3; 3]> {
    (0..count)
        .map(|_| {
            let center = random.vec3();
            [(); 3].map(|()| center + random.vec3() * size)
        })
        .collect()
}

/// A triangle by itself, and the direction of a ray exactly through its first corner, of which only exact integers tell
/// so: pairs of doubles do not hold its coordinates.
pub const APART: [Vec3; 3] = [Vec3::new(2.5, 0.25, 0.0), Vec3::new(2.8, 0.3, 0.4), Vec3::new(2.1, 0.9, -0.3)];
pub const AT_APART: Vec3 = Vec3::new(-0.5, -0.25, 3e-20);

/// A wavy sheet of 2 n^2 triangles that share edges and vertices.
pub fn sheet(n: usize) -> Vec<[Vec3; 3]> {
    let point = |x: usize, y: usize| {
        let (x, y) = (2.0 * x as f32 / n as f32 - 1.0, 2.0 * y as f32 / n as f32 - 1.0);
        Vec3::new(x, y, 0.2 * (5.0 * x).sin() * (4.0 * y).cos())
    };
    let cells = (0..n).flat_map(|y| (0..n).map(move |x| (x, y)));
    cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [point(x, y), point(x + 1, y), point(x + 1, y + 1), point(x, y + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect()
}
