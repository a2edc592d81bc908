//! `raybrook warm-up`: has the device's kernels compiled before anybody waits for them.
//!
//! It traces and renders a little, as any user would: some drivers compile a kernel only when it is launched first.

use super::flags::in_flags;
use super::{DEVICE_VARIABLE, MemoryArgs, Talk, open};
use raybrook::glam::{Vec2, Vec3};
use raybrook::low_level::scene::{Image, Normals};
use raybrook::{Builder, Material, Ray, Result, Scene, Tracer, View};
use std::collections::HashSet;
use std::path::PathBuf;
use std::time::Instant;

#[derive(clap::Args)]
pub struct WarmUpArgs {
    /// Scenes whose pictures shall begin at once, as for render [default: models of usual kinds, made in code].
    ///
    /// Kernels of pictures have just what a scene needs: so many kinds of scenes, so many kernels. Those of rays and
    /// points are the same for nearly all scenes, and are always compiled.
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// gpu, cpu, or a number or part of a name of `raybrook devices` [default: the fastest].
    #[arg(long, value_name = "DEVICE", env = DEVICE_VARIABLE, hide_env_values = true)]
    device: Option<String>,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// Something to ask of a tracer, by its name.
type Task = (&'static str, fn(&mut Tracer) -> Result<()>);

const BATCHES: [Task; 7] = [
    ("closest hits", |tracer| tracer.closest_hits(&rays()).map(drop)),
    ("any hits", |tracer| tracer.any_hits(&rays()).map(drop)),
    ("all hits", |tracer| tracer.all_hits(&rays()).map(drop)),
    ("first hits", |tracer| tracer.first_hits(&rays(), 2).map(drop)),
    ("counts of hits", |tracer| tracer.count_hits(&rays()).map(drop)),
    ("crossings", |tracer| tracer.count_crossings(&rays()).map(drop)),
    ("closest points", |tracer| tracer.closest_points(&[[0.0; 3]; 64]).map(drop)),
];

const PICTURES: [Task; 2] = [
    ("by its error", |tracer| tracer.render(&View::new(SIDE, SIDE)).map(drop)),
    ("of fixed samples", |tracer| tracer.render(&View::new(SIDE, SIDE).samples(4)).map(drop)),
];

/// Pixels of a side of the pictures.
const SIDE: u32 = 64;

pub fn run(args: &WarmUpArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    // What is wrong with a file comes before what takes time.
    let budget = args.memory.budget();
    let load = |path: &PathBuf| {
        let loaded = open::load_with_objects(path, false, &budget, talk)?;
        Ok((path.display().to_string(), loaded.scene))
    };
    let given = args.scenes.iter().map(load).collect::<Result<Vec<_>>>()?;
    let mut told = HashSet::new();
    let mut tracer = tracer_of(args, &hard_scene()?)?;
    if tracer.device_kind().is_none() {
        tell_notes(&tracer, &mut told, talk);
        if !talk.quiet {
            tell!("note: {} has no kernels, nothing to do", tracer.device_name());
        }
        return Ok(());
    }
    let device = tracer.device_name().to_owned();
    BATCHES.iter().try_for_each(|task| carry_out(&mut tracer, "", task, talk))?;
    tell_notes(&tracer, &mut told, talk);
    let mut pictures = |name: &str, scene: &Scene| -> Result<()> {
        let mut tracer = tracer_of(args, scene)?;
        let of = format!("picture of {name}, ");
        PICTURES.iter().try_for_each(|task| carry_out(&mut tracer, &of, task, talk))?;
        tell_notes(&tracer, &mut told, talk);
        Ok(())
    };
    given.iter().try_for_each(|(name, scene)| pictures(name, scene))?;
    if given.is_empty() {
        Model::ALL.iter().try_for_each(|model| pictures(model.name, &model.scene()?))?;
    }
    if !talk.quiet {
        say!("{device}: {:.1} s", start.elapsed().as_secs_f64());
    }
    Ok(())
}

fn tracer_of(args: &WarmUpArgs, scene: &Scene) -> Result<Tracer> {
    // All kernels are to be compiled.
    let builder = Tracer::builder(scene).device_alone();
    let builder = match &args.device {
        Some(device) => builder.device(device),
        None => builder,
    };
    match args.memory.memory_limit {
        Some(bytes) => builder.memory_limit(bytes).build(),
        None => builder.build(),
    }
}

/// Tells what is worth knowing and was not `told` yet: why there is no device, or that kernels cannot be kept.
fn tell_notes(tracer: &Tracer, told: &mut HashSet<String>, talk: Talk) {
    for note in tracer.notes() {
        if !talk.quiet && !told.contains(&note) {
            tell!("note: {}", in_flags(&note));
        }
        told.insert(note);
    }
}

fn carry_out(tracer: &mut Tracer, of: &str, (name, task): &Task, talk: Talk) -> Result<()> {
    let start = Instant::now();
    task(tracer)?;
    if !talk.quiet {
        say!("{:7.2} s  {of}{name}", start.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Two triangles that share an edge, of corners with bits so far apart that rays through it take every step there is
/// to exact hits.
fn hard_scene() -> Result<Scene> {
    let tiny = f32::exp2(-60.0);
    let corners = [[0.0, tiny, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];
    Scene::from_mesh(&corners, &[[2, 0, 1], [3, 1, 0]])
}

/// Rays through that edge, beside it, and past everything: enough that some go in packets wherever there are any.
fn rays() -> Vec<Ray> {
    let ray = |i: u16| {
        let x = [0.0, 0.1, 2.0][usize::from(i % 3)];
        Ray::new([x, f32::from(i % 64 + 1) / 66.0, 1.0], [0.0, 0.0, -1.0])
    };
    (0..1024).map(ray).collect()
}

/// What a model has that kernels of pictures are made for.
struct Model {
    name: &'static str,
    is_smooth: bool,
    has_materials: bool,
    has_textures: bool,
}

impl Model {
    /// Those that most files hold: scans, and what modelling programs write.
    const ALL: [Model; 6] = {
        let bare = Model { name: "a flat model", is_smooth: false, has_materials: false, has_textures: false };
        [
            Model { name: "a smooth model", is_smooth: true, ..bare },
            Model { name: "a flat model with materials", has_materials: true, ..bare },
            Model { name: "a smooth model with materials", is_smooth: true, has_materials: true, ..bare },
            Model { name: "a flat model with textures", has_materials: true, has_textures: true, ..bare },
            Model { name: "a smooth model with textures", is_smooth: true, has_materials: true, has_textures: true },
            bare,
        ]
    };

    /// A tent of such a kind.
    fn scene(&self) -> Result<Scene> {
        let mut builder = Builder::new();
        let normals = if self.is_smooth { Normals::Smooth } else { Normals::Flat };
        let positions = [Vec3::NEG_X, Vec3::X, Vec3::Y, Vec3::Z];
        let uvs = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];
        let texture = self.has_textures.then(|| {
            let rgba = vec![[255, 200, 100, 255]; 4];
            builder.add_texture(Image { name: "made in code".into(), width: 2, height: 2, rgba })
        });
        let sides: [&[[u32; 3]]; 2] = [&[[0, 3, 2]], &[[3, 1, 2]]];
        for (side, light) in sides.into_iter().zip([0.5, 0.8]) {
            if self.has_materials {
                let matt = Material::matt(Vec3::splat(light));
                let specular = Vec3::splat(0.5);
                builder.material(Material { diffuse_texture: texture, specular, shininess: 30.0, ..matt });
            }
            builder.mesh(&positions, normals, &uvs, side);
        }
        builder.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::low_level::features::Features;
    use std::collections::HashSet;

    /// Else a name would promise what is not compiled, or something would be compiled twice.
    #[test]
    fn models_have_what_their_names_say() {
        let features = Model::ALL.map(|model| Features::of_scene(&model.scene().unwrap()).to_string());
        for (model, features) in Model::ALL.iter().zip(&features) {
            for (name, has) in [
                ("smooth-normals", model.is_smooth),
                ("several-materials", model.has_materials),
                ("highlights", model.has_materials),
                ("image-textures", model.has_textures),
            ] {
                assert_eq!(features.contains(name), has, "{}: {features}", model.name);
            }
        }
        assert_eq!(features.iter().collect::<HashSet<_>>().len(), features.len());
    }
}
