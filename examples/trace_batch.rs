//! From arrays to hits: a height map of a mesh, and what of it sees the sun. `cargo run --release --example
//! trace_batch`.
#![allow(clippy::print_stdout)]

use raybrook::{Ray, Result, Scene, Tracer};

fn main() -> Result<()> {
    // A pyramid on a floor; no file, no types of this library.
    let floor = [[-4.0, 0.0, -4.0], [4.0, 0.0, -4.0], [4.0, 0.0, 4.0], [-4.0, 0.0, 4.0]];
    let pyramid = [[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 3.0, 0.0], [0.0, 0.0, -2.0]];
    let positions = [&floor[..], &pyramid].concat();
    let triangles = [[0, 2, 1], [0, 3, 2], [4, 6, 7], [6, 5, 7], [5, 8, 7], [8, 4, 7]];
    let mut tracer = Tracer::new(&Scene::from_mesh(&positions, &triangles)?)?;

    let side = 24;
    let place = |i: usize| -3.0 + 6.0 * (i as f32 + 0.5) / side as f32;
    let down: Vec<Ray> =
        (0..side * side).map(|i| Ray::new([place(i % side), 10.0, place(i / side)], [0.0, -1.0, 0.0])).collect();
    let hits = tracer.closest_hits(&down)?;
    let height = |i: usize| hits[i].map_or(0.0, |hit| 10.0 - hit.t);

    // A shadow ray starts at each hit and goes on to infinity. t is rounded once, by 4 EPSILON at most as it is below
    // 16, and the start once more, by 1 EPSILON as it is below 4: with 10 of them it is above its triangle for sure.
    let start = |i: usize| [down[i].origin[0], height(i) + 10.0 * f32::EPSILON, down[i].origin[2]];
    let to_sun: Vec<Ray> = (0..down.len()).map(|i| Ray::new(start(i), [1.0, 0.8, 0.3])).collect();
    let is_dark = tracer.any_hits(&to_sun)?;
    for row in 0..side {
        let symbol = |i: usize| if is_dark[i] { '#' } else { ['.', '-', '=', '+'][height(i).round() as usize] };
        println!("{}", (0..side).map(|x| symbol(row * side + x)).collect::<String>());
    }
    Ok(())
}
