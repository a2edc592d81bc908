//! Which way is up in a model whose file does not say: y, unless its shape tells that it is z.
//!
//! What a thing stands on tells which way up it is (Fu, Cohen-Or, Dror & Sheffer, "Upright orientation of man-made
//! objects", SIGGRAPH 2008, sections 3 and 4: a base that is flat and that it does not tip over on). Theirs weighs
//! measures of every face of the convex hull. Here are three plain rules about the two axes that programs use, each for
//! what y-up models are not:
//!
//! - level ground across z, seen from above;
//! - a terrain over a rectangle of x and y;
//! - a base plate across z, of something that would tip over along y.
//!
//! The shape is seen by [`GRID`] x [`GRID`] lines along an axis. What they cross is counted, so that the answer does
//! not depend on the triangles' order.
//!
//! Bad at: everything else. A wall with things on it is level ground that stands, a bottle may lie, a car's bottom has
//! wheels: where no rule is sure, y it is, as a model that stood and falls over is worse than one that lies.

use crate::parallel;
use glam::{DVec3, Vec3};

/// Lines in a row, and rows of lines.
const GRID: usize = 32;

/// Where in its cell of the grid a line is: off the middle and the fractions on which regular models have vertices.
const IN_CELL: [f64; 2] = [0.4786, 0.5331];

/// The share of lines that must agree. Of ground and terrains in 278 models they were 0.97 or more; of a scanned face,
/// an open sheet that faces z with y up, 0.83.
const NEARLY_ALL: f64 = 0.95;

/// The share of lines along y that meets a floor where y is up. Those of rooms do, and 0.69 in a room with z up.
const MOST: f64 = 0.8;

/// How thick a level is, and how far up it may lie to be at the lower end, in parts of the model's height.
const LEVEL: f64 = 0.05;
const LOWER_END: f64 = 0.3;

/// How high what stands on the ground is at least, of its own width: frames and reliefs on a wall are flatter.
const TALL: f64 = 0.5;
/// The same of everything, of the ground's width: then what is on it need not be known.
const HIGH: f64 = 0.2;

/// A terrain has at least so many triangles, and is so high, of its width. Its slopes along x and y are alike to this
/// factor, unlike those of a curtain.
const TERRAIN_TRIANGLES: usize = 64;
const TERRAIN_HEIGHT: f64 = 0.02;
const SLOPES: f64 = 0.25;
/// The least share of the model's box that the terrain's rectangle has.
const TERRAIN_SHARE: f64 = 0.6;

/// How flat a base is, and how near to the lower end something touches the ground along y, in parts of the height.
const FLAT: f64 = 0.01;
const TOUCHES: f64 = 0.02;
/// The share of the model's lower side that what touches the ground spans, if the model does not tip over; and the
/// share of its upper side that is flat, too, if it is a beam.
const SPAN: f64 = 0.5;

/// The up that the shape of `count` triangles tells, and why; `None`: nothing that is sure.
pub(crate) fn up_by_shape(
    count: usize,
    triangle: &(impl Fn(usize) -> [Vec3; 3] + Sync),
) -> Option<(Vec3, &'static str)> {
    let shape = Shape::new(count, triangle)?;
    let along_y = shape.lines(1);
    if share(along_y.level(|_| true).0) >= MOST || along_y.sheet().is_some() {
        return None;
    }
    let along_z = shape.lines(2);
    let (ground, level) = along_z.level(|line| line.first_faces_up);
    let reason = if share(ground) >= NEARLY_ALL {
        let stands = shape.height() >= HIGH || shape.is_tall_above(level + 2.0 * LEVEL);
        stands.then_some("the model has level ground across z, and none across y")
    } else if shape.is_terrain(&along_y, &along_z) {
        Some("the model is a terrain over x and y")
    } else {
        shape.has_base(&along_z).then_some("the model stands on a flat base across z, and would tip over along y")
    };
    reason.map(|reason| (Vec3::Z, reason))
}

/// A count of lines as a share of all of them.
fn share(lines: usize) -> f64 {
    lines as f64 / (GRID * GRID) as f64
}

/// Triangles that can be hit, and the box around them.
struct Shape<'a, F> {
    count: usize,
    triangle: &'a F,
    low: DVec3,
    size: DVec3,
}

/// Triangles of one task, at least.
const PART: usize = 1 << 14;

/// Tasks at most: each has lines of its own.
const PARTS: usize = 64;

impl<F: Fn(usize) -> [Vec3; 3] + Sync> Shape<'_, F> {
    /// `None` where they have no volume: flat things stand as they are.
    fn new(count: usize, triangle: &F) -> Option<Shape<'_, F>> {
        let (low, high) = points_box(count, triangle, |_| true)?;
        let size = high - low;
        size.cmpgt(DVec3::ZERO).all().then_some(Shape { count, triangle, low, size })
    }

    /// What lines along `axis` cross.
    fn lines(&self, axis: usize) -> Lines {
        let size = self.count.div_ceil(PARTS).max(PART);
        let parts = parallel::map(0..self.count.div_ceil(size), |part| {
            let mut lines = Lines::none();
            for i in part * size..self.count.min((part + 1) * size) {
                lines.cross((self.triangle)(i).map(|p| (p.as_dvec3() - self.low) / self.size), axis);
            }
            lines
        });
        parts.into_iter().fold(Lines::none(), Lines::joined)
    }

    /// The model's height along z, in parts of its width.
    fn height(&self) -> f64 {
        self.size.z / self.size.x.max(self.size.y)
    }

    /// Whether what is above `level`, in parts of the height, is about as high as it is wide.
    fn is_tall_above(&self, level: f64) -> bool {
        let from = self.low.z + level * self.size.z;
        points_box(self.count, self.triangle, |p| p.z > from).is_some_and(|(low, high)| {
            let size = high - low;
            high.z - from >= TALL * size.x.max(size.y)
        })
    }

    fn is_terrain(&self, along_y: &Lines, along_z: &Lines) -> bool {
        let is_sheet = along_z.sheet().is_some_and(|sheet| share(sheet) >= TERRAIN_SHARE);
        if !is_sheet || self.count < TERRAIN_TRIANGLES || self.height() < TERRAIN_HEIGHT {
            return false;
        }
        // How much surface is seen along x, and along y.
        let x = self.lines(0).crossings() as f64 * self.size.y;
        let y = along_y.crossings() as f64 * self.size.x;
        x.min(y) >= SLOPES * x.max(y)
    }

    fn has_base(&self, along_z: &Lines) -> bool {
        let is_flat = |line: &&Line| line.first < FLAT;
        let is_flat_above = |line: &&Line| line.last > 1.0 - FLAT;
        let count = |is: &dyn Fn(&&Line) -> bool| share(along_z.0.iter().filter(is).count());
        if self.height() < TALL || count(&is_flat) < NEARLY_ALL || count(&is_flat_above) >= SPAN {
            return false;
        }
        let from = self.low.y + TOUCHES * self.size.y;
        points_box(self.count, self.triangle, |p| p.y <= from).is_some_and(|(low, high)| {
            let span = (high - low) / self.size;
            span.x * span.z < SPAN
        })
    }
}

/// The smallest box around those corners of `count` triangles that `counts`.
fn points_box(
    count: usize,
    triangle: &(impl Fn(usize) -> [Vec3; 3] + Sync),
    counts: impl Fn(DVec3) -> bool + Sync,
) -> Option<(DVec3, DVec3)> {
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let around = |(low, high): (DVec3, DVec3), other: (DVec3, DVec3)| (low.min(other.0), high.max(other.1));
    let of_triangle = |i: usize| {
        let points = triangle(i).into_iter().map(|p| p.as_dvec3()).filter(|&p| counts(p));
        points.fold(empty, |all, p| around(all, (p, p)))
    };
    let all = parallel::reduce_numbers(count, empty, of_triangle, around);
    (all != empty).then_some(all)
}

/// What a line crosses. Places are in parts of the model's size along it.
#[derive(Clone, Copy)]
struct Line {
    crossings: u32,
    /// Crossings of surface that faces up, along the axis, less those of surface that faces down: 0 of closed things.
    net: i32,
    first: f64,
    first_faces_up: bool,
    last: f64,
}

/// All lines along one axis, in rows.
struct Lines(Vec<Line>);

impl Lines {
    fn none() -> Lines {
        let none = Line { crossings: 0, net: 0, first: f64::INFINITY, first_faces_up: false, last: f64::NEG_INFINITY };
        Lines(vec![none; GRID * GRID])
    }

    /// Crosses a triangle of the unit cube by those lines along `axis` that meet it. Lines that a rounding has miss or
    /// meet it at an edge are a few of many.
    fn cross(&mut self, [a, b, c]: [DVec3; 3], axis: usize) {
        let sides = [(axis + 1) % 3, (axis + 2) % 3];
        // Where lines are whole numbers.
        let [pa, pb, pc] = [a, b, c].map(|p| [0, 1].map(|i| p[sides[i]] * GRID as f64 - IN_CELL[i]));
        let range = |i: usize| {
            let (low, high) = (pa[i].min(pb[i]).min(pc[i]), pa[i].max(pb[i]).max(pc[i]));
            let last = (GRID - 1) as f64;
            // Rounded away from each other where there is no line between.
            low.ceil().max(0.0) as usize..(high.floor().min(last) + 1.0).max(0.0) as usize
        };
        let (rows, columns) = (range(0), range(1));
        let (edge1, edge2) = ([pb[0] - pa[0], pb[1] - pa[1]], [pc[0] - pa[0], pc[1] - pa[1]]);
        let area = edge1[0] * edge2[1] - edge1[1] * edge2[0];
        if columns.is_empty() || area == 0.0 {
            return;
        }
        for row in rows {
            for column in columns.clone() {
                let from_a = [row as f64 - pa[0], column as f64 - pa[1]];
                let u = (from_a[0] * edge2[1] - from_a[1] * edge2[0]) / area;
                let v = (edge1[0] * from_a[1] - edge1[1] * from_a[0]) / area;
                if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                    let place = a[axis] + u * (b[axis] - a[axis]) + v * (c[axis] - a[axis]);
                    self.0[row * GRID + column].add(place, area > 0.0);
                }
            }
        }
    }

    fn joined(mut self, other: Lines) -> Lines {
        self.0.iter_mut().zip(other.0).for_each(|(line, other)| line.join(&other));
        self
    }

    fn crossings(&self) -> u64 {
        self.0.iter().map(|line| u64::from(line.crossings)).sum()
    }

    /// How many of the lines that `counts` first meet something at one level of the lower end, and where that begins:
    /// of all levels that with the most.
    fn level(&self, counts: impl Fn(&Line) -> bool) -> (usize, f64) {
        let counted = self.0.iter().filter(|line| line.first <= LOWER_END && counts(line));
        let mut places: Vec<f64> = counted.map(|line| line.first).collect();
        places.sort_by(f64::total_cmp);
        let within = |i: usize| places[i..].partition_point(|&place| place <= places[i] + LEVEL);
        let (count, begin) = (0..places.len()).map(|i| (within(i), i)).max().unwrap_or_default();
        (count, places.get(begin).copied().unwrap_or_default())
    }

    /// How many lines there are in the smallest rectangle of all those that end on another side of the surface than
    /// they began, if nearly all of these once cross surface that faces up: there is an open sheet, and all else is
    /// closed.
    fn sheet(&self) -> Option<usize> {
        let open = (0..GRID * GRID).filter(|&i| self.0[i].net != 0);
        let (low, high) = open.fold(((GRID, GRID), (0, 0)), |(low, high), i| {
            let (row, column) = (i / GRID, i % GRID);
            ((low.0.min(row), low.1.min(column)), (high.0.max(row + 1), high.1.max(column + 1)))
        });
        let lines = high.0.saturating_sub(low.0) * high.1.saturating_sub(low.1);
        let facing_up = self.0.iter().filter(|line| line.net == 1).count();
        (lines > 0 && facing_up as f64 >= NEARLY_ALL * lines as f64).then_some(lines)
    }
}

impl Line {
    fn add(&mut self, place: f64, faces_up: bool) {
        let net = if faces_up { 1 } else { -1 };
        self.join(&Line { crossings: 1, net, first: place, first_faces_up: faces_up, last: place });
    }

    fn join(&mut self, other: &Line) {
        self.first_faces_up = match self.first.total_cmp(&other.first) {
            std::cmp::Ordering::Less => self.first_faces_up,
            std::cmp::Ordering::Equal => self.first_faces_up || other.first_faces_up,
            std::cmp::Ordering::Greater => other.first_faces_up,
        };
        self.crossings = self.crossings.saturating_add(other.crossings);
        self.net = self.net.saturating_add(other.net);
        (self.first, self.last) = (self.first.min(other.first), self.last.max(other.last));
    }
}

#[cfg(test)]
mod tests {
    use super::super::Builder;
    use super::*;

    type Triangles = Vec<[Vec3; 3]>;

    fn of(build: impl FnOnce(&mut Builder)) -> Triangles {
        let mut builder = Builder::new();
        build(&mut builder);
        let scene = builder.finish().unwrap();
        scene.hittable().into_iter().map(|i| scene.vertices(i as usize)).collect()
    }

    fn moved(triangles: Triangles, way: Vec3) -> Triangles {
        triangles.into_iter().map(|t| t.map(|p| p + way)).collect()
    }

    fn cuboid(size: Vec3, middle: Vec3) -> Triangles {
        moved(of(|b| _ = b.cuboid(size)), middle)
    }

    /// A sheet of `steps` x `steps` squares over x and z from -1 to 1 that faces up, y.
    fn sheet(steps: u32, height: impl Fn(f32, f32) -> f32) -> Triangles {
        let at = |i: u32, k: u32| {
            let [x, z] = [i, k].map(|i| 2.0 * i as f32 / steps as f32 - 1.0);
            Vec3::new(x, height(x, z), z)
        };
        let square = |i: u32, k: u32| {
            let [a, b, c, d] = [at(i, k), at(i, k + 1), at(i + 1, k + 1), at(i + 1, k)];
            [[a, b, c], [a, c, d]]
        };
        (0..steps).flat_map(|i| (0..steps).flat_map(move |k| square(i, k))).collect()
    }

    fn hills(x: f32, z: f32) -> f32 {
        0.3 * (5.0 * x).sin() * (4.0 * z + 1.0).cos() + 0.1 * x
    }

    /// Turned so that what faced y faces z.
    fn lifted(triangles: &[[Vec3; 3]]) -> Triangles {
        triangles.iter().map(|t| t.map(|Vec3 { x, y, z }| Vec3::new(x, -z, y))).collect()
    }

    /// Turned by a quarter about y.
    fn turned(triangles: &[[Vec3; 3]]) -> Triangles {
        triangles.iter().map(|t| t.map(|Vec3 { x, y, z }| Vec3::new(z, y, -x))).collect()
    }

    /// Walls that are seen from inside: those of a box whose sides are not left out.
    fn room(sides: &[usize]) -> Triangles {
        let all = cuboid(Vec3::new(4.0, 2.5, 3.0), Vec3::Y * 1.25);
        let inward = |[a, b, c]: [Vec3; 3]| {
            let side = |p: [f32; 3]| (0..3).find(|&i| p[i].abs() > 0.9).map(|i| 2 * i + usize::from(p[i] > 0.0));
            let normal = (b - a).cross(c - a).normalize().to_array();
            side(normal).filter(|side| sides.contains(side)).map(|_| [a, c, b])
        };
        all.into_iter().filter_map(inward).collect()
    }

    /// Boxes on the plane y = 0, of different heights.
    fn things(scale: f32) -> Triangles {
        let thing = |i: u32| {
            let (x, z, height) = (i as f32 * 0.3 - 0.6, (i * 7 % 5) as f32 * 0.3 - 0.6, 0.2 + i as f32 * 0.25);
            cuboid(Vec3::new(0.2, height, 0.2) * scale, Vec3::new(x, height / 2.0, z) * scale)
        };
        (0..5).flat_map(thing).collect()
    }

    /// As the same from all sides and in any order.
    fn found(triangles: &[[Vec3; 3]]) -> Option<&'static str> {
        let up = |triangles: &[[Vec3; 3]]| up_by_shape(triangles.len(), &|i| triangles[i]);
        let found = up(triangles);
        let mirrored: Triangles =
            triangles.iter().map(|[a, b, c]| [c, b, a].map(|p| p * Vec3::new(-1.0, 1.0, 1.0))).collect();
        let backwards: Triangles = triangles.iter().rev().map(|&[a, b, c]| [b, c, a].map(|p| p * 1e30)).collect();
        assert_eq!(up(&mirrored), found);
        assert_eq!(up(&backwards), found);
        assert!(found.is_none_or(|(up, _)| up == Vec3::Z));
        found.map(|(_, reason)| reason)
    }

    #[test]
    fn z_is_up_where_a_rule_says_so_and_never_in_the_same_thing_with_y_up() {
        let flat = |_: f32, _: f32| 0.0;
        let plinth = || {
            let ball = |y: f32, radius: f32| moved(of(|b| _ = b.sphere(radius, 24)), Vec3::Y * y);
            [cuboid(Vec3::new(2.0, 0.3, 1.6), Vec3::Y * 0.15), ball(0.9, 0.6), ball(1.9, 0.5)].concat()
        };
        for (name, upright, rule) in [
            ("a terrain", sheet(40, hills), "terrain"),
            ("a terrain with things on it", [sheet(40, hills), moved(things(0.3), Vec3::Y * 0.4)].concat(), "terrain"),
            (
                "a terrain with a box beside it",
                [sheet(40, hills), cuboid(Vec3::splat(0.2), Vec3::X * 1.2)].concat(),
                "terrain",
            ),
            ("things on ground", [sheet(1, flat), things(1.0)].concat(), "level ground"),
            ("a small thing on ground", [sheet(1, flat), things(0.02)].concat(), "level ground"),
            ("an open room", room(&[0, 1, 2, 4]), "level ground"),
            ("a stage with a ceiling", room(&[0, 1, 2, 3, 4]), "level ground"),
            ("a statue on a plinth", plinth(), "flat base"),
        ] {
            // From the side a wall of a room is as much of a floor as the floor.
            let is_room = name == "an open room" || name == "a stage with a ceiling";
            let from_the_side = if is_room { upright.clone() } else { turned(&upright) };
            for upright in [&upright, &from_the_side] {
                assert_eq!(found(upright), None, "{name}");
                let reason = found(&lifted(upright));
                assert!(reason.is_some_and(|reason| reason.contains(rule)), "{name}: {reason:?}");
            }
        }
    }

    #[test]
    fn what_no_rule_is_sure_of_stays() {
        let wheel = |x: f32, z: f32| cuboid(Vec3::new(0.2, 0.4, 0.4), Vec3::new(x, 0.2, z));
        let wheels = || [wheel(0.8, -2.0), wheel(-0.8, -2.0), wheel(0.8, 2.0), wheel(-0.8, 2.0)].concat();
        let bus = [
            cuboid(Vec3::new(1.8, 1.6, 6.0), Vec3::Y),
            cuboid(Vec3::new(1.0, 0.6, 0.8), Vec3::new(0.0, 0.6, 3.2)),
            wheels(),
        ];
        let log = of(|b| _ = b.cylinder(0.5, 4.0, 32));
        let face = |x: f32, z: f32| 0.9 * (1.0 - x * x - z * z).max(0.0).sqrt();
        let oval: Triangles = sheet(40, face).into_iter().filter(|t| t.iter().all(|p| p.x.hypot(p.z) < 1.0)).collect();
        let frame = cuboid(Vec3::new(0.6, 0.05, 0.4), Vec3::Y * 0.03);
        for (name, thing) in [
            ("a cube", cuboid(Vec3::ONE, Vec3::ONE)),
            ("a slab", cuboid(Vec3::new(3.0, 0.2, 2.0), Vec3::ZERO)),
            ("a ball", of(|b| _ = b.sphere(1.0, 32))),
            (
                "a statue without a base",
                [of(|b| _ = b.sphere(1.0, 32)), moved(of(|b| _ = b.sphere(0.6, 32)), Vec3::Y * 1.4)].concat(),
            ),
            ("a closed room", room(&[0, 1, 2, 3, 4, 5])),
            ("a bus along z", bus.concat()),
            ("a log", log),
            ("a curtain", sheet(40, |x, _| 0.2 * (9.0 * x).sin())),
            ("a ramp", sheet(4, |_, z| z)),
            ("a mask", oval),
            ("a picture on a wall", [sheet(1, |_, _| 0.0), frame].concat()),
            ("a poster", sheet(8, |_, _| 0.0)),
            ("one triangle", sheet(8, hills)[..1].to_vec()),
            ("nothing", Vec::new()),
        ] {
            for thing in [&thing, &turned(&thing), &lifted(&thing), &lifted(&turned(&thing))] {
                assert_eq!(found(thing), None, "{name}");
            }
        }
    }

    #[test]
    fn coordinates_at_the_ends_of_float32_are_no_trouble() {
        let far = [[Vec3::MAX, Vec3::MIN, Vec3::X], [Vec3::ZERO, Vec3::MAX, Vec3::MIN * Vec3::Z]];
        assert_eq!(up_by_shape(2, &|i| far[i]), None);
        let tiny = sheet(40, hills).iter().map(|t| lifted(&[*t])[0].map(|p| p * 1e-44)).collect::<Vec<_>>();
        _ = up_by_shape(tiny.len(), &|i| tiny[i]);
    }
}
