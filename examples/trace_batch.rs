//! From arrays to hits: a height map of a mesh, and what of it sees the sun. `cargo run --release --example
//! trace_batch`.
#![allow(clippy::print_stdout)]

use raybrook::{Ray, Result, Scene, Tracer};

fn main() -> Result<()> {
    // A pyramid on a floor; no file, no types of this library.
    let positions = [
        [-4.0, 0.0, -4.0],
        [4.0, 0.0, -4.0],
        [4.0, 0.0, 4.0],
        [-4.0, 0.0, 4.0],
        [-2.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [0.0, 0.0, 2.0],
        [0.0, 3.0, 0.0],
        [0.0, 0.0, -2.0],
    ];
    let triangles = [[0, 2, 1], [0, 3, 2], [4, 6, 7], [6, 5, 7], [5, 8, 7], [8, 4, 7]];
    let mut tracer = Tracer::new(&Scene::from_mesh(&positions, &triangles)?)?;

    let side = 24;
    let place = |i: usize| -3.0 + 6.0 * (i as f32 + 0.5) / side as f32;
    let down: Vec<Ray> =
        (0..side * side).map(|i| Ray::new([place(i % side), 10.0, place(i / side)], [0.0, -1.0, 0.0])).collect();
    let hits = tracer.closest_hits(&down)?;

    // A shadow ray starts at each hit, a little above it, and goes on to infinity.
    let height = |i: usize| hits[i].map_or(0.0, |hit| 10.0 - hit.t);
    let to_sun: Vec<Ray> = down
        .iter()
        .enumerate()
        .map(|(i, ray)| Ray::new([ray.origin[0], height(i) + 1e-3, ray.origin[2]], [1.0, 0.8, 0.3]))
        .collect();
    let is_dark = tracer.any_hits(&to_sun)?;
    for row in 0..side {
        let symbol = |i: usize| if is_dark[i] { '#' } else { ['.', '-', '=', '+'][height(i).round() as usize] };
        println!("{}", (0..side).map(|x| symbol(row * side + x)).collect::<String>());
    }
    Ok(())
}
