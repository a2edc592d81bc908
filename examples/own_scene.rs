//! A scene made by a program: solids, materials, a light and a camera. `cargo run --release --example own_scene
//! [PICTURE.png]`.
#![allow(clippy::print_stdout)]

use raybrook::glam::Vec3;
use raybrook::{Builder, Camera, Light, Material, Result, Tracer, View};

fn main() -> Result<()> {
    let mut builder = Builder::new();
    builder.material(Material::matt(Vec3::new(0.5, 0.55, 0.6)));
    builder.quad(Vec3::new(-20.0, 0.0, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0, 1);
    for (i, colour) in [Vec3::new(0.8, 0.2, 0.1), Vec3::new(0.1, 0.6, 0.2), Vec3::new(0.1, 0.3, 0.8)].iter().enumerate()
    {
        builder.material(Material { mirror: Vec3::splat(0.2), ..Material::matt(*colour) });
        builder.push().translate(Vec3::new(2.5 * i as f32 - 2.5, 1.0, 0.0)).sphere(1.0, 64).pop();
    }
    builder.material(Material { transmission: Vec3::splat(0.95), ior: 1.5, ..Material::matt(Vec3::ZERO) });
    builder.push().translate(Vec3::new(0.8, 0.6, 2.6)).sphere(0.6, 64).pop();
    builder.light(Light::directional(Vec3::new(0.5, -1.0, -0.6), Vec3::splat(0.9)));
    builder.camera(Camera { eye: Vec3::new(0.0, 3.0, 9.0), target: Vec3::Y, up: Vec3::Y, fov_degrees: 40.0 });
    let scene = builder.finish()?;

    let path = std::env::args().nth(1).unwrap_or("own_scene.png".to_owned());
    let mut tracer = Tracer::new(&scene)?;
    tracer.render(&View::new(640, 360))?.save(&path)?;
    println!("{path}: {} triangles on {}", scene.triangle_count(), tracer.device_name());
    Ok(())
}
