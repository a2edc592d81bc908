//! Makes what in `scenes/` is made by program: two models, two textures and the sphere flakes.
//!
//! `cargo run -p raybrook-lab --example make_scenes` writes them again; `tests/scene/scene_file.rs` checks that the
//! files are what this makes. Numbers are written with few digits, so that the libraries of different systems agree on
//! them.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::path::Path;

/// A picture of 8-bit sRGB pixels, top row first.
pub struct Picture {
    /// Pixels of a side.
    pub side: u32,
    /// Red, green, blue.
    pub rgb: Vec<[u8; 3]>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    std::fs::create_dir_all(folder.join("textures"))?;
    for (name, text) in texts() {
        std::fs::write(folder.join(name), text)?;
    }
    for (name, picture) in pictures() {
        let file = std::fs::File::create(folder.join(name))?;
        let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), picture.side, picture.side);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(picture.rgb.as_flattened())?;
        writer.finish()?;
    }
    Ok(())
}

/// The files of text, by their names in `scenes/`.
pub fn texts() -> Vec<(&'static str, String)> {
    vec![("vase.obj", vase()), ("knot.obj", knot()), ("spheres.toml", sphere_flake()), ("flake.toml", large_flake())]
}

/// The textures, by their names in `scenes/`.
pub fn pictures() -> Vec<(&'static str, Picture)> {
    vec![("textures/planks.png", planks()), ("textures/tiles.png", tiles())]
}

type Point = [f64; 3];

// ---- models
// ----------------------------------------------------------------------------------------------------------

/// A surface as an OBJ text: a grid of points with normals; texture coordinates run from 0 to 1 along both.
/// `wraps`: the last column, or row, is the first one again.
fn grid_obj(
    title: &str,
    columns: usize,
    rows: usize,
    wraps: [bool; 2],
    point: impl Fn(f64, f64) -> (Point, Point),
) -> String {
    let mut text = format!("# {title}\n# Made by examples/make_scenes.rs. MIT OR Apache-2.0.\n");
    let (width, height) = (columns + usize::from(!wraps[0]), rows + usize::from(!wraps[1]));
    let share = |i: usize, n: usize| i as f64 / n as f64;
    let (mut positions, mut normals) = (Vec::new(), String::new());
    for j in 0..height {
        for i in 0..width {
            let (p, n) = point(share(i, columns), share(j, rows));
            positions.push(p.map(|x| short(x, 4)).join(" "));
            _ = writeln!(normals, "vn {}", n.map(|x| short(x, 3)).join(" "));
        }
    }
    positions.iter().for_each(|p| _ = writeln!(text, "v {p}"));
    text += &normals;
    for j in 0..=rows {
        for i in 0..=columns {
            _ = writeln!(text, "vt {} {}", short(share(i, columns), 4), short(share(j, rows), 4));
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let places = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
            let vertex = |k: usize| (places[k % 4].1 % height) * width + places[k % 4].0 % width;
            // Where the grid shrinks to a point, two corners are one: a triangle is left.
            let corners: Vec<usize> = (0..4).filter(|&k| positions[vertex(k)] != positions[vertex(k + 3)]).collect();
            let corner = |k: &usize| {
                let (v, (i, j)) = (vertex(*k) + 1, places[*k]);
                format!("{v}/{}/{v}", j * (columns + 1) + i + 1)
            };
            _ = writeln!(text, "f {}", corners.iter().map(corner).collect::<Vec<_>>().join(" "));
        }
    }
    text
}

/// `value` with at most `digits` decimals; never "-0".
fn short(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// The torus knot (2, 3), a trefoil, as a tube: it lies around the z axis within 3.5 of it, 1.5 to both sides.
fn knot() -> String {
    const TUBE: f64 = 0.5;
    grid_obj("Trefoil knot, outside counter-clockwise", 240, 24, [true; 2], |u, v| {
        let (t, w) = (u * TAU, v * TAU);
        let (ring, ring_slope) =
            ([(2.0 * t).cos(), (2.0 * t).sin(), 0.0], [-2.0 * (2.0 * t).sin(), 2.0 * (2.0 * t).cos(), 0.0]);
        let (sin, cos) = (3.0 * t).sin_cos();
        // The tube's middle is 2 ring + normal; normal and tangent are perpendicular, so that with their cross product
        // they make a frame that closes after one turn.
        let normal = add(scaled(ring, cos), [0.0, 0.0, sin]);
        let tangent = add(scaled(ring_slope, 2.0 + cos), add(scaled(ring, -3.0 * sin), [0.0, 0.0, 3.0 * cos]));
        let binormal = unit(cross(normal, tangent));
        let outward = add(scaled(normal, w.cos()), scaled(binormal, w.sin()));
        (add(add(scaled(ring, 2.0), normal), scaled(outward, TUBE)), outward)
    })
}

/// A vase as a body of revolution around y, 3 high, with a wall and a round lip: the profile goes from the middle of
/// the foot up the outside, over the lip and down the inside to the middle of the bottom.
fn vase() -> String {
    const ROWS: usize = 72;
    let profile = vase_profile(ROWS);
    let slope = |j: usize| {
        let (before, after) = (profile[j.saturating_sub(1)], profile[(j + 1).min(ROWS)]);
        let (dr, dy) = (after[0] - before[0], after[1] - before[1]);
        let length = dr.hypot(dy);
        [dy / length, -dr / length]
    };
    grid_obj("Vase, outside counter-clockwise", 80, ROWS, [true, false], |u, v| {
        let j = (v * ROWS as f64).round() as usize;
        let (sin, cos) = (u * TAU).sin_cos();
        let ([r, y], [nr, ny]) = (profile[j], slope(j));
        ([r * sin, y, r * cos], [nr * sin, ny, nr * cos])
    })
}

/// Radius and height along the vase's profile.
fn vase_profile(rows: usize) -> Vec<[f64; 2]> {
    const HEIGHT: f64 = 3.0;
    const WALL: f64 = 0.07;
    const LIP_ROWS: usize = 8;
    const FOOT_ROWS: usize = 6;
    let outside = |y: f64| {
        // A belly low down, a slender neck, a rim that opens again.
        let h = y / HEIGHT;
        0.42 + 0.62 * (PI * h.powf(0.62)).sin().powi(2) - 0.08 * h + 0.22 * ((h - 0.72).max(0.0) / 0.28).powi(2)
    };
    let wall_rows = (rows - LIP_ROWS - 2 * FOOT_ROWS) / 2;
    let inside_rows = rows - LIP_ROWS - 2 * FOOT_ROWS - wall_rows;
    let mut profile = Vec::with_capacity(rows + 1);
    let foot = outside(0.0);
    // The foot: flat, its edge rounded by a quarter circle of the wall's width.
    profile.push([0.0, 0.0]);
    for i in 0..FOOT_ROWS {
        let (sin, cos) = (PI / 2.0 * i as f64 / (FOOT_ROWS - 1) as f64).sin_cos();
        profile.push([foot - WALL + WALL * sin, WALL - WALL * cos]);
    }
    let top = HEIGHT - WALL / 2.0;
    for i in 1..=wall_rows {
        let y = WALL + (top - WALL) * i as f64 / wall_rows as f64;
        profile.push([outside(y) + (outside(0.0) - outside(WALL)) * (1.0 - i as f64 / wall_rows as f64), y]);
    }
    for i in 1..=LIP_ROWS {
        let (sin, cos) = (PI * i as f64 / LIP_ROWS as f64).sin_cos();
        profile.push([outside(top) - WALL / 2.0 + WALL / 2.0 * cos, top + WALL / 2.0 * sin]);
    }
    let bottom = 0.35;
    for i in 1..=inside_rows {
        let y = top + (bottom - top) * i as f64 / inside_rows as f64;
        profile.push([outside(y) - WALL, y]);
    }
    // The bottom of the inside: a quarter of an ellipse to the middle.
    let edge = profile[profile.len() - 1];
    while profile.len() <= rows {
        let left = (rows - profile.len()) as f64;
        let (sin, cos) = (PI / 2.0 * (1.0 - left / FOOT_ROWS as f64)).sin_cos();
        profile.push([edge[0] * cos.max(0.0), edge[1] - 0.2 * sin]);
    }
    if let Some(last) = profile.last_mut() {
        last[0] = 0.0;
    }
    profile
}

fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

fn scaled(a: Point, s: f64) -> Point {
    a.map(|x| x * s)
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Point) -> Point {
    scaled(a, 1.0 / (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt())
}

// ---- the sphere flake
// ------------------------------------------------------------------------------------------------

/// `spheres.toml`: a sphere with nine spheres of a third of its radius on it, and nine on each of these (after E.
/// Haines, "A Proposal for Standard Graphics Environments", IEEE CG&A 1987, whose flake it is not: arrangement and
/// colours are ours).
fn sphere_flake() -> String {
    const SEGMENTS: [u32; 3] = [64, 32, 20];
    let mut text = String::from(SPHERES_HEAD);
    add_spheres(FIRST_SPHERE, SEGMENTS.len(), &mut |sphere: &Sphere| {
        let [x, y, z] = sphere.center.map(|c| short(c, 4));
        let (r, level) = (short(sphere.radius, 4), sphere.level);
        let segments = SEGMENTS[level];
        _ = writeln!(
            text,
            "    {{ solid = \"sphere\", radius = {r}, segments = {segments}, translate = [{x}, {y}, {z}], material = \
             \"level{level}\" }},"
        );
    });
    text += "]\n";
    text += SPHERES_TAIL;
    text
}

/// `flake.toml`: the same with two levels more, as instances of one sphere.
fn large_flake() -> String {
    const LEVELS: usize = 5;
    let mut text = String::from(FLAKE_HEAD);
    add_spheres(FIRST_SPHERE, LEVELS, &mut |sphere: &Sphere| {
        let [x, y, z] = sphere.center.map(|c| short(c, 5));
        let (r, material) = (short(sphere.radius, 5), sphere.level.min(2));
        _ = writeln!(text, "    {{ scale = {r}, translate = [{x}, {y}, {z}], material = \"level{material}\" }},");
    });
    text += "]\n";
    text += SPHERES_TAIL;
    text
}

struct Sphere {
    center: Point,
    radius: f64,
    /// Away from its parent.
    axis: Point,
    level: usize,
}

const FIRST_SPHERE: Sphere = Sphere { center: [0.0, 1.0, 0.0], radius: 1.0, axis: [0.0, 1.0, 0.0], level: 0 };

/// Shows a sphere and those that stand on it, up to so many levels.
fn add_spheres(sphere: Sphere, levels: usize, show: &mut impl FnMut(&Sphere)) {
    show(&sphere);
    let Sphere { center, radius, axis, level } = sphere;
    if level + 1 == levels {
        return;
    }
    // A frame around the axis that points away from the parent.
    let helper = if axis[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let side = unit(cross(helper, axis));
    let other = cross(axis, side);
    for child in 0..9 {
        // Six around the equator, three above, turned by half a step.
        let (tilt, turn) = if child < 6 {
            (PI / 2.0, TAU * child as f64 / 6.0)
        } else {
            (PI / 5.0, TAU * (child as f64 + 0.25) / 3.0)
        };
        let across = add(scaled(side, turn.cos()), scaled(other, turn.sin()));
        let away = add(scaled(axis, tilt.cos()), scaled(across, tilt.sin()));
        let center = add(center, scaled(away, radius * 4.0 / 3.0));
        add_spheres(Sphere { center, radius: radius / 3.0, axis: away, level: level + 1 }, levels, show);
    }
}

const SPHERES_HEAD: &str = "\
# 91 spheres: each has nine of a third of its size. Made by examples/make_scenes.rs. MIT OR Apache-2.0.

object = [
    { solid = \"disc\", radius = 9, segments = 96, material = \"floor\" },
";

const FLAKE_HEAD: &str = "\
# 7381 spheres: each has nine of a third of its size. Made by examples/make_scenes.rs. MIT OR Apache-2.0.

[[object]]
solid = \"disc\"
radius = 9
segments = 96
material = \"floor\"

# One sphere in the memory, wherever it stands.
[[object]]
solid = \"sphere\"
instances = [
";

const SPHERES_TAIL: &str = "
[image]
width = 960
height = 720
samples = 16

[camera]
eye = [2.3, 3.3, 5.2]
target = [0.0, 1.12, 0.0]
fov = 35

[trace]
depth = 6
ambient = 0.12
background = { bottom = [0.55, 0.62, 0.68], top = [0.06, 0.14, 0.34] }

[[light]]
kind = \"directional\"
direction = [-0.55, -1.0, -0.35]
intensity = 0.85
color = [1.0, 0.95, 0.86]

[[light]]
kind = \"point\"
position = [-5.0, 4.0, 4.0]
intensity = 0.3
color = [0.75, 0.85, 1.0]

[material.floor]
diffuse = [0.16, 0.17, 0.19]
mirror = 0.06

[material.level0]
diffuse = [0.05, 0.06, 0.08]
specular = 0.6
shininess = 400
mirror = [0.62, 0.66, 0.72]

[material.level1]
diffuse = [0.55, 0.2, 0.02]
specular = 0.5
shininess = 120
mirror = [0.2, 0.13, 0.05]

[material.level2]
diffuse = [0.02, 0.3, 0.32]
specular = 0.4
shininess = 60
";

// ---- textures
// --------------------------------------------------------------------------------------------------------

/// A whole number, scrambled: the finaliser of MurmurHash3 (Appleby 2011), as a value in 0..1.
fn random(x: i64, y: i64, seed: u32) -> f64 {
    let mut h =
        (x as u32).wrapping_mul(0x9e37_79b1) ^ (y as u32).wrapping_mul(0x85eb_ca77) ^ seed.wrapping_mul(0xc2b2_ae3d);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    f64::from(h ^ (h >> 16)) / f64::from(u32::MAX)
}

/// Smooth noise in 0..1 that repeats after `period` cells.
fn noise(x: f64, y: f64, period: [i64; 2], seed: u32) -> f64 {
    let (column, row) = (x.floor(), y.floor());
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (s, t) = (smooth(x - column), smooth(y - row));
    let value = |i: i64, j: i64| {
        random((column as i64 + i).rem_euclid(period[0]), (row as i64 + j).rem_euclid(period[1]), seed)
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    mix(mix(value(0, 0), value(1, 0), s), mix(value(0, 1), value(1, 1), s), t)
}

/// A picture of `side`² pixels from a function of the pixel's place, 0..1 from the left and from the top.
fn picture(side: u32, colour: impl Fn(f64, f64) -> [f64; 3]) -> Picture {
    let place = |i: u32| (f64::from(i) + 0.5) / f64::from(side);
    let pixels = (0..side * side)
        .map(|i| colour(place(i % side), place(i / side)).map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8));
    Picture { side, rgb: pixels.collect() }
}

/// Five oak planks from left to right, their joints staggered; repeats in both directions.
fn planks() -> Picture {
    const PLANKS: f64 = 5.0;
    picture(320, |x, y| {
        let plank = (y * PLANKS).floor();
        let across = y * PLANKS - plank;
        // Each row of planks has one joint of its own.
        let along = (x + random(plank as i64, 0, 11)).rem_euclid(1.0);
        let tone = random(plank as i64, 1, 12);
        let seed = 20 + plank as u32;
        // Growth rings: lines along the plank that wander, with finer fibres between them.
        let wander = noise(along * 4.0, across * 3.0, [4, 64], seed);
        let rings = (TAU * (across * 2.6 + 1.9 * wander)).sin() * 0.5 + 0.5;
        let fibres = noise(along * 24.0, across * 40.0, [24, 64], seed + 10);
        let pores = noise(along * 48.0, across * 28.0, [48, 64], seed + 30);
        let light = 0.74 + 0.17 * tone + 0.1 * rings + 0.12 * (fibres - 0.5) - 0.13 * (pores - 0.72).max(0.0) / 0.28;
        let gap = if across < 0.022 || along < 0.004 { 0.5 } else { 1.0 };
        [0.74, 0.54 - 0.03 * tone, 0.355 - 0.035 * tone].map(|c| c * light * gap)
    })
}

/// Sixteen glazed tiles in two colours, grout between them; repeats in both directions.
fn tiles() -> Picture {
    const TILES: f64 = 4.0;
    const GROUT: f64 = 0.035; // half its width, in tiles
    picture(256, |x, y| {
        let (column, row) = ((x * TILES).floor(), (y * TILES).floor());
        let (u, v) = (x * TILES - column, y * TILES - row);
        if u.min(v) < GROUT || u.max(v) > 1.0 - GROUT {
            return [0.62, 0.6, 0.57];
        }
        let shade =
            0.93 + 0.07 * random(column as i64, row as i64, 3) + 0.05 * (noise(x * 16.0, y * 16.0, [16, 16], 4) - 0.5);
        let colour = if (column + row) % 2.0 == 0.0 { [0.9, 0.88, 0.82] } else { [0.22, 0.4, 0.5] };
        colour.map(|c| c * shade)
    })
}
