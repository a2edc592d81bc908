//! How many rays slip through a closed model: `cargo run --release --example compare_methods [MODEL]`.
//!
//! The rays are aimed at edges and vertices, where float32 arithmetic goes wrong, and each is proved to hit something.
//! Without a model a sphere is traced.
#![allow(clippy::print_stdout)]

use raybrook::{Builder, Error, Ray, Result, Scene, Tracer};
use raybrook_lab::stress::Mesh;
use raybrook_lab::stress::closed::ClosedMesh;

const RAYS: u64 = 100_000;
const SEED: u64 = 1;

fn main() -> Result<()> {
    let scene = match std::env::args().nth(1) {
        Some(path) => Scene::load(path)?,
        None => {
            let mut builder = Builder::new();
            builder.sphere(1.0, 64);
            builder.finish()?
        }
    };
    let closed = ClosedMesh::new(Mesh::try_from(&scene)?).map_err(|why| Error::Scene(why.to_string()))?;
    let aimed = |i| {
        let ray = closed.ray(SEED, i);
        Ray::new(ray.origin.into(), ray.direction.into())
    };
    let rays: Vec<Ray> = (0..RAYS).map(aimed).collect();
    for method in ["exact", "moller-trumbore", "watertight", "plucker"] {
        let mut tracer = Tracer::builder(&scene).method(method).build()?;
        let misses = tracer.closest_hits(&rays)?.iter().filter(|hit| hit.is_none()).count();
        println!("{method:>16}: {misses:>6} of {RAYS} rays slip through, on {}", tracer.device_name());
    }
    Ok(())
}
