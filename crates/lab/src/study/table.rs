//! What a study measured, as rows of named values, and what the names mean.
//!
//! A value has the same name wherever it is told: in the JSON, the CSV, the report's tables and, spelled out, on the
//! axes of charts.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Named values of one measurement.
pub type Row = Map<String, Value>;

/// Some rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Its name among those of its study, of letters, digits and '-'.
    pub name: String,
    /// What is in it, in one sentence.
    pub caption: String,
    /// The rows; what does not apply to one is left out of it.
    pub rows: Vec<Row>,
}

impl Table {
    /// A table of `rows`.
    pub fn new(name: &str, caption: impl Into<String>, rows: Vec<Row>) -> Table {
        Table { name: name.to_owned(), caption: caption.into(), rows }
    }

    /// The names of all values, in the order in which rows first have them.
    pub fn columns(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for name in self.rows.iter().flat_map(Map::keys) {
            if !names.contains(&name.as_str()) {
                names.push(name);
            }
        }
        names
    }

    /// Those of them that a reader wants to see: not the times of every round.
    pub fn shown_columns(&self) -> Vec<&str> {
        let is_list = |name: &&str| self.rows.iter().any(|row| row.get(*name).is_some_and(Value::is_array));
        self.columns().into_iter().filter(|name| !is_list(name)).collect()
    }

    /// The table as CSV: the names, and a line for each row, without a value where there is none.
    pub fn to_csv(&self) -> csv::Result<Vec<u8>> {
        let columns = self.columns();
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&columns)?;
        for row in &self.rows {
            writer.write_record(columns.iter().map(|&column| row.get(column).map(text).unwrap_or_default()))?;
        }
        writer.into_inner().map_err(|error| error.into_error().into())
    }
}

/// A value as CSV has it: texts bare, numbers as JSON has them.
fn text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        value => value.to_string(),
    }
}

/// A number of a row; `None` where there is none.
pub fn number(row: &Row, name: &str) -> Option<f64> {
    row.get(name).and_then(Value::as_f64)
}

/// A text of a row, or a number as text; empty where there is none.
pub fn name(row: &Row, name: &str) -> String {
    row.get(name).map(text).unwrap_or_default()
}

/// The values of a column as texts, each once, in the order of the rows.
pub fn values<'a>(rows: impl IntoIterator<Item = &'a Row>, column: &str) -> Vec<String> {
    let mut values = Vec::new();
    for value in rows.into_iter().map(|row| name(row, column)) {
        if !values.contains(&value) {
            values.push(value);
        }
    }
    values
}

/// A row of these values.
pub fn row<const N: usize>(values: [(&str, Value); N]) -> Row {
    values.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// A row of those of these values that are there.
pub fn known<V: Into<Value>, const N: usize>(values: [(&str, Option<V>); N]) -> Row {
    values.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?.into()))).collect()
}

/// What a value's name means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// The name.
    pub name: &'static str,
    /// As people read it, with its unit.
    pub label: &'static str,
    /// More about it.
    pub about: &'static str,
}

/// The meaning of a name.
///
/// # Panics
/// When there is none: a study has a value that its reader could not understand.
pub fn column(name: &str) -> &'static Column {
    COLUMNS.iter().find(|column| column.name == name).unwrap_or_else(|| panic!("the column '{name}' is not explained"))
}

macro_rules! columns {
    ($($name:literal: $label:literal, $about:literal;)*) => {
        /// All names of values.
        pub const COLUMNS: &[Column] = &[$(Column { name: $name, label: $label, about: $about }),*];
    };
}

columns! {
    "scene": "scene", "the model, made by the program unless it is a file";
    "triangles": "triangles", "those that can be hit";
    "method": "method", "the parts that trace";
    "panel": "panel", "what was traced";
    "tracer": "tracer", "raybrook: timed by turns in this run; another: by a program of its own, on the same rays";
    "machine": "machine", "on which another tracer ran";
    "threads": "threads", "of another tracer";
    "clock": "clock", "wall clock: from a pass's beginning to its end; device time: of its kernels alone";
    "call": "call", "the other tracer's function";
    "faults": "sorts of wrong answers", "of another tracer, as `raybrook stress` names them";
    "pass_s": "pass (s)", "of another tracer, by its clock, median";
    "rays_of": "rays",
        "camera: one for each pixel, in tiles; shadow: from their hits to the light, any hit; diffuse: from there by a \
         cosine lobe";
    "rays": "rays traced", "in one pass";
    "structure": "structure", "what is traced through";
    "promise": "promise",
        "what is claimed of the method: exact by construction, or nothing; what this run found is another matter";
    "mrays_per_s": "Mrays/s",
        "million rays a second of device time, of another tracer by its clock, by the median pass";
    "mrays_low": "Mrays/s, slowest pass", "";
    "mrays_high": "Mrays/s, fastest pass", "";
    "relative": "speed relative to the fastest", "geometric mean over camera, shadow and diffuse rays";
    "relative_low": "lowest relative speed", "of all rounds";
    "relative_high": "highest relative speed", "of all rounds";
    "passes": "rounds", "timed, by turns with the other methods of the table";
    "rounds_s": "seconds of each round",
        "of device time, not sorted, so that rounds of two methods can be compared one by one";
    "wall_rounds_s": "seconds of each round", "by the wall clock, likewise";
    "wall_s": "seconds, wall clock",
        "from the call to the finished picture, median: launches and the gaps between them, what the host decides and \
         computes, reading back";
    "wall_low": "seconds, wall clock, fastest", "";
    "wall_high": "seconds, wall clock, slowest", "";
    "wrong": "wrong answers",
        "another triangle, a hit for a miss or a miss for a hit, by the f64 oracle and, where it differs, by rational \
         arithmetic";
    "tested": "answers checked", "";
    "wrong_per_million": "wrong answers per million rays", "";
    "differing": "answers that differ",
        "that name another triangle than exact arithmetic does, or none, or one for none: also where a ray that is off \
         by no more than rounding would have it so, which is not counted as wrong";
    "differing_low": "answers that differ per million rays, at least (95 % bound)", "";
    "differing_bound": "answers that differ per million rays, at most (95 % bound)",
        "from exact arithmetic, rounding not forgiven";
    "wrong_low": "wrong answers per million rays, at least (95 % bound)",
        "the exact one-sided lower bound of Clopper and Pearson";
    "wrong_bound": "wrong answers per million rays, at most (95 % bound)",
        "the exact one-sided upper bound of Clopper and Pearson for every count; where none of N was wrong about 3 \
         million / N";
    "largest_t_ulp": "largest error of t (ulp)",
        "in units in the last place, against the oracle in f64, where the triangle is right";
    "steps": "steps a ray", "nodes, cells or clusters that a ray looks at";
    "leaves": "leaves a ray", "";
    "tests": "triangle tests a ray", "";
    "restarts": "restarts a ray", "";
    "node_bytes": "bytes of nodes a ray", "what the traversal asks for";
    "triangle_bytes": "bytes of triangles a ray", "what the tests ask for";
    "bytes_a_ray": "bytes a ray", "of nodes and triangles, as asked for";
    "deepest_stack": "deepest stack", "";
    "build_s": "build (s)", "the structure, on the host";
    "compile_s": "compile (s)", "the kernels, or loading them from a cache";
    "upload_s": "upload (s)", "the scene, to the device";
    "rays_upload_s": "upload of rays (s)", "";
    "read_s": "read-back (s)", "";
    "kernel_s": "kernel (s)", "device time of one pass, median";
    "device_bytes": "bytes on the device", "";
    "bytes_per_triangle": "bytes a triangle", "of everything on the device";
    "stored_triangles": "triangles stored", "of instances one copy of each object, where they stay shared";
    "leaf_size": "most triangles in a leaf", "";
    "max_depth": "deepest leaf", "limit of the tree's depth";
    "stack_size": "entries of the short stack", "";
    "device": "device", "";
    "build": "build", "what chooses the kd-tree's planes, or brute force";
    "memory": "kind of memory", "";
    "value": "value", "";
    "scale": "size of the scene", "largest coordinate, in units of 1";
    "offset": "distance of the scene from zero", "in units of its own size";
    "distance": "distance of the origin", "in units of the scene's size";
    "angle": "angle to the surface (radians)", "";
    "aspect": "length of triangles by their width", "";
    "valence": "triangles at a vertex", "";
    "gap": "gap between layers (ulp)", "floats between one layer's coordinate and the next one's";
    "mode": "failure mode", "a kind of `raybrook stress`";
    "cubes": "cubes", "of 12 triangles each";
    "frames_per_s": "frames a second", "of the picture by the wall clock, or of 640 x 480 camera rays by the device's";
    "tests_per_s": "million tests a second", "";
    "flops_a_test": "operations a test",
        "floating-point operations of Moller and Trumbore's test, fma counted as two, counted test by test up to where \
         each may end";
    "most_flops_a_test": "operations of a whole test", "of one that does not end early";
    "flop_per_byte": "operations a byte", "arithmetic intensity: operations a test by bytes of vertices a test";
    "gflops": "Gflop/s", "operations of triangle tests alone";
    "limit": "limit",
        "of the device: arithmetic, reads of an array that all work-items read, copies from memory to memory";
    "unit": "unit", "";
    "reached": "reached", "by the triangle tests";
    "limit_value": "limit's value", "by a kernel that does nothing else";
    "limit_share": "share of the limit", "";
    "samples": "samples a pixel", "";
    "depth": "longest chain of rays", "the camera ray counted as 1";
    "limited_by": "limited by",
        "what keeps rays from being cast: the depth of chains, a least weight, or Russian roulette below a weight";
    "weight": "weight", "below which rays are killed, all of them or at random";
    "pixels": "pixels", "";
    "seconds": "seconds, device and host",
        "device time of the picture and what the host takes to decide what is traced and to compute textures, median";
    "decide_s": "of them the host's (s)", "between the rounds of a picture by its error, median";
    "seconds_low": "seconds, fastest", "";
    "seconds_high": "seconds, slowest", "";
    "asked": "error asked for (8-bit steps)", "";
    "error": "error (8-bit steps)", "root of the mean squared error to the converged picture, sRGB";
    "needs": "needs", "the features that its materials, normals and lamps use";
    "features": "features", "of the kernels: the scene's, or all";
    "feature_count": "number of features", "";
    "unused_bytes": "bytes left out",
        "of materials and textures that no triangle has, and of normals and texture coordinates that nothing reads";
    "time_of_all": "time, of kernels with all features", "one sample a pixel, with the scene's features against all";
    "private_of_all": "private memory, of kernels with all features", "of a work-item";
    "binary_of_all": "binary, of kernels with all features", "";
    "rays_of_every": "rays, of all", "one sample a pixel, without those that cannot change a pixel, against all";
    "rays_of_fixed": "rays at error 1, of 16 samples", "";
    "time_of_fixed": "time at error 1, of 16 samples", "the host's decisions counted";
    "error_of_fixed": "error of 16 samples (8-bit steps)", "";
    "rays_at_flip": "fewest rays with the FLIP of 16 samples, of theirs",
        "of the pictures by their error that are in the table";
    "frame_bytes": "frame (bytes)", "arrays and spilled registers of a work-item, where the driver tells";
    "binary_bytes": "binary (bytes)", "of the kernels of pictures";
    "rmse": "RMSE to the converged picture", "linear radiance";
    "flip": "FLIP to the converged picture", "mean, 0 to 1";
    "wrong_pixels": "pixels that differ from the reference's", "as 8-bit sRGB, of a small picture of the same";
    "checked_pixels": "pixels compared with the reference's", "";
    "tree_cost": "expected cost",
        "of a ray through the kd-tree's box by its surface areas (MacDonald and Booth 1990), a step and a test counted \
         as 1 each";
    "kernels": "kernels", "";
    "textures": "textures", "";
    "figure": "figure", "";
    "occupancy": "occupancy", "the part of the warps that a compute unit can hold which fit there at a time";
    "spilled_bytes": "spilled registers (bytes)", "of the instructions that store them";
    "local_bytes": "local memory (bytes)", "of a work-group";
    "cells": "cells along each side", "of the grid";
    "test": "triangle test", "";
    "explained": "explained", "the part of the variation of the times that steps and tests explain";
    "registers": "registers", "of a work-item, where the driver tells";
    "private_bytes": "private memory (bytes)", "of a work-item, where the driver tells";
    "work_group": "work-group", "largest for the kernel";
    "launches": "launches", "";
    "textures_s": "of them the host's pass (s)", "fetching hits, computing and sending colours, median";
    "host_colours": "colours by the host", "of textures, in one pass";
    "step": "part", "";
    "share": "share of the time", "";
    "plane": "plane", "whether a huge plane of two triangles is in the scene";
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn csv_has_every_value_and_a_gap_where_there_is_none() {
        let rows = vec![
            row([("method", json!("a \"b\", c")), ("steps", json!(1.5))]),
            row([("method", json!("d")), ("wrong", json!(0))]),
        ];
        let csv = String::from_utf8(Table::new("t", "", rows).to_csv().unwrap()).unwrap();
        assert_eq!(csv, "method,steps,wrong\n\"a \"\"b\"\", c\",1.5,\nd,,0\n");
    }

    #[test]
    fn names_are_explained_once() {
        for (i, column) in COLUMNS.iter().enumerate() {
            assert!(COLUMNS[..i].iter().all(|other| other.name != column.name), "{}", column.name);
            assert!(!column.label.is_empty());
        }
    }
}
