mod common;
use common::shared;
use glam::DVec3;
use raybrook::reference::oracle::{Oracle, OracleHit, OracleRay};
use raybrook::scene::{LightKind, Scene, load};
use raybrook::shared::NO_PRIMITIVE;
use rayon::prelude::*;

const SIZE: u32 = 513;

struct Whitted<'a> {
    scene: &'a Scene,
    oracle: &'a Oracle,
    tri: &'a [[DVec3;3]],
    lights: Vec<DVec3>,
    opaque: bool,
    depth: u32,
}

#[derive(Default, Clone, Copy, Debug)]
struct Counts { eye: u64, hit: u64, shadow: u64, blocked: u64, rl: u64, rr: u64 , sh: [u64;6], inside: u64, tir: u64}

impl Whitted<'_> {
    fn leave(&self, point: DVec3, error: f64, primitive: u32, direction: DVec3, t_max: f64) -> OracleRay {
        OracleRay { origin: point, direction, t_min: 2.0 * error / direction.abs().max_element(), t_max, skip: primitive }
    }
    fn trace(&self, ray: &OracleRay, depth: u32, counts: &mut Counts) {
        let Some(hit) = self.oracle.closest(ray) else { return };
        if depth == 1 { counts.hit += 1; }
        let OracleHit { primitive, t, .. } = hit;
        let [p0, p1, p2] = self.tri[primitive as usize];
        let point = ray.origin + ray.direction * t;
        let largest = p0.abs().max(p1.abs()).max(p2.abs()).max(ray.origin.abs()).max_element();
        let error = 6.0 * f64::EPSILON * largest;
        let outward = (p1 - p0).cross(p2 - p0).normalize();
        let d = ray.direction.normalize();
        let front = outward.dot(d) < 0.0;
        let normal = if front { outward } else { -outward };
        if !front { counts.inside += 1; }
        let both = std::env::var("BOTH").is_ok();
        let n_sh = if both { outward } else { normal };
        for &light in &self.lights {
            let l = light - point;
            if n_sh.dot(l) > 0.0 {
                counts.sh[depth as usize] += 1;
                if depth == 1 { counts.shadow += 1; }
                let blocked = self.oracle.is_blocked(&self.leave(point, error, primitive, l, 1.0));
                if depth == 1 { counts.blocked += u64::from(blocked); }
            }
        }
        if depth >= self.depth { return; }
        let m = &self.scene.materials[self.scene.triangles[primitive as usize].material as usize];
        let (ks, tr) = (m.mirror.x, m.transmission.x);
        let cos_in = -normal.dot(d);
        if ks > 0.0 || tr > 0.0 {
            counts.rl += 1;
            let r = d + normal * (2.0 * cos_in);
            self.trace(&self.leave(point, error, primitive, r, f64::INFINITY), depth + 1, counts);
        }
        if tr > 0.0 {
            let ior = std::env::var("IOR").ok().map(|v| v.parse().unwrap()).unwrap_or(1.1f64);
            let eta = if front { 1.0 / ior } else { ior };
            let s2 = eta * eta * (1.0 - cos_in * cos_in);
            if s2 < 1.0 {
                counts.rr += 1;
                let r = d * eta + normal * (eta * cos_in - (1.0 - s2).sqrt());
                self.trace(&self.leave(point, error, primitive, r, f64::INFINITY), depth + 1, counts);
            } else { counts.tir += 1; }
        }
    }
}

fn count(name: &str, depth: u32) -> Option<Counts> {
    let scene = load(shared(&format!("spd/{name}.nff"))?).unwrap();
    let text = std::fs::read_to_string(shared(&format!("spd/{name}.nff"))?).unwrap();
    let mut tri = Vec::new(); let mut cur = Vec::new();
    let mut lights = Vec::new(); let mut view = [DVec3::ZERO; 3];
    for line in text.lines() {
        let mut w = line.split_whitespace();
        let k = w.next().unwrap();
        let n: Vec<f64> = line.split_whitespace().filter_map(|w| w.parse().ok()).collect();
        let v = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
        match k { "l" => lights.push(v(&n)), "from" => view[0] = v(&n), "at" => view[1] = v(&n), "up" => view[2] = v(&n),
            _ if k.parse::<f64>().is_ok() => { cur.push(v(&n)); if cur.len() == 3 { tri.push([cur[0], cur[1], cur[2]]); cur.clear(); } } _ => {} }
    }
    let oracle = Oracle::of_triangles(&tri);
    let camera = scene.camera.unwrap();
    let eye = view[0];
    let forward = (view[1] - eye).normalize();
    let right = forward.cross(view[2]).normalize();
    let up = right.cross(forward);
    let half = (f64::from(camera.fov_degrees).to_radians() / 2.0).tan();
    let w = Whitted { scene: &scene, oracle: &oracle, tri: &tri, lights, opaque: true, depth };
    Some((0..SIZE).into_par_iter().map(|j| {
        let mut counts = Counts::default();
        for i in 0..SIZE {
            let (x, y) = (f64::from(i) / 256.0 - 1.0, 1.0 - f64::from(j) / 256.0);
            counts.eye += 1;
            let ray = OracleRay { origin: eye, direction: forward + right * (x * half) + up * (y * half), t_min: 0.0, t_max: f64::INFINITY, skip: NO_PRIMITIVE };
            w.trace(&ray, 1, &mut counts);
        }
        counts
    }).reduce(Counts::default, |a, b| Counts { eye: a.eye + b.eye, hit: a.hit + b.hit, shadow: a.shadow + b.shadow, blocked: a.blocked + b.blocked, rl: a.rl + b.rl, rr: a.rr + b.rr, sh: std::array::from_fn(|i| a.sh[i]+b.sh[i]), inside: a.inside+b.inside, tir: a.tir+b.tir }))
}

#[test]
fn explore() {
    for name in ["tetra", "gears"] {
        let s = std::time::Instant::now();
        let d: u32 = std::env::var("DEPTH").map(|d| d.parse().unwrap()).unwrap_or(1);
        let c = count(name, d).unwrap();
        println!("{name} {c:?} total {} {:?}", c.eye + c.sh.iter().sum::<u64>() + c.rl + c.rr, s.elapsed());
    }
}
