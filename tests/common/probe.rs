//! Runs a few OpenCL statements on a device with all functions of `cl/` at hand, and compares what they write with a
//! twin's results.

use super::SEED;
use glam::Vec3;
use raybrook::low_level::device::{Buffer, CompileOptions, DeviceContext, KERNEL_FILES, ProgramSource, build};

/// Written behind every output and still there afterwards.
const CANARY: f32 = -12345.0;
const CANARIES: usize = 16;

/// Runs `body`, OpenCL statements that read `in[0..inputs]` and write `out[0..outputs]`, once for each group of
/// `inputs` numbers.
pub fn run(
    device: &raybrook::low_level::device::DeviceHandle,
    body: &str,
    inputs: usize,
    outputs: usize,
    data: &[f32],
) -> Vec<f32> {
    run_with(device, CompileOptions::new(), body, inputs, outputs, data)
}

/// The same with further definitions.
pub fn run_with(
    device: &raybrook::low_level::device::DeviceHandle,
    options: CompileOptions,
    body: &str,
    inputs: usize,
    outputs: usize,
    data: &[f32],
) -> Vec<f32> {
    let kernel = format!(
        "__kernel void probe(__global const float* restrict data, __global float* restrict results) {{\n\
         const size_t item = get_global_id(0);\n\
         __global const float* in = data + item * {inputs};\n__global float* out = results + item * {outputs};\n\
         {body}\n}}\n"
    );
    let context = DeviceContext::open(device).unwrap();
    let source = ProgramSource::new(KERNEL_FILES.iter().copied().chain([("tests/probe.cl", kernel.as_str())]));
    let options = options
        .define("TRAVERSE", "traverse_kd_stack")
        .define("INTERSECT", "intersect_watertight")
        .define("HITS", "rounded");
    let program = build(&context, &source, &options, None).unwrap().program;
    let items = data.len() / inputs;
    let mut results = vec![CANARY; items * outputs + CANARIES];
    let input = Buffer::from_slice(&context, "input", data).unwrap();
    let output = Buffer::read_write(&context, "output", &results).unwrap();
    let mut kernel = program.kernel("probe").unwrap();
    kernel.set_arg(0, &input).unwrap();
    kernel.set_arg(1, &output).unwrap();
    kernel.launch(&[items], None).unwrap().wait().unwrap();
    results = output.read().unwrap();
    assert!(results[items * outputs..].iter().all(|&x| x == CANARY), "the kernel wrote behind its output");
    results.truncate(items * outputs);
    results
}

/// Compares device and twin bit for bit (any NaN equals any NaN).
pub fn assert_same_bits(name: &str, inputs: usize, data: &[f32], got: &[f32], expected: &[f32]) {
    assert_eq!(got.len(), expected.len(), "{name}");
    let outputs = got.len() / (data.len() / inputs);
    let same = |a: f32, b: f32| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan());
    let wrong: Vec<_> = (0..got.len()).filter(|&i| !same(got[i], expected[i])).collect();
    if let Some(&i) = wrong.first() {
        let item = i / outputs;
        panic!(
            "{name}: {} of {} numbers differ; first: item {item}, output {}: device {:e}, twin {:e}, inputs {:?} \
             (seed {SEED})",
            wrong.len(),
            got.len(),
            i % outputs,
            got[i],
            expected[i],
            &data[item * inputs..(item + 1) * inputs]
        );
    }
}

/// Three numbers as a vector.
pub fn v3(data: &[f32]) -> Vec3 {
    Vec3::new(data[0], data[1], data[2])
}

/// 1 or 0, as the test kernels write a bool.
pub fn flag(b: bool) -> f32 {
    if b { 1.0 } else { 0.0 }
}
