//! Tracing space: the units in which everything is traced, and a scene's triangles in them.

use crate::accel::Aabb;
use crate::parallel;
use crate::scene::Scene;
use glam::Vec3;

/// Tracing space has its largest coordinate in [1, 2): products of three coordinates of a scene, and of triangles a
/// billion times smaller than it, stay far from both ends of float32, and a ray may start 2^126 times its size away.
/// Being relative to the scene, it also makes every result independent of the scene's unit when that changes by a power
/// of two.
const LARGEST_COORDINATE_EXPONENT: i32 = 0;
const LARGEST_SCALE_EXPONENT: i32 = 100;

/// The power of two that takes `bounds` to tracing space.
pub(super) fn tracing_scale(low: Vec3, high: Vec3) -> f32 {
    let largest = low.abs().max(high.abs()).max_element();
    if largest == 0.0 {
        return 1.0;
    }
    let exponent = f64::from(largest).log2().floor() as i32;
    // t changes by this factor, too: the largest and smallest scenes keep some distance to 1, so that it stays a normal
    // float.
    2f32.powi((LARGEST_COORDINATE_EXPONENT - exponent).clamp(-LARGEST_SCALE_EXPONENT, LARGEST_SCALE_EXPONENT))
}

/// The power of two that takes a scene to tracing space.
pub fn scale_of(scene: &Scene) -> f32 {
    let (low, high) = scene.bounds().unwrap_or_default();
    tracing_scale(low, high)
}

/// The triangles in world units where one of them loses bits on its way to tracing space; zeros for those that cannot
/// be hit. Only numbers that become smaller can.
pub(super) fn vertices_that_lose_bits(scene: &Scene, scale: f32) -> Option<Vec<[Vec3; 3]>> {
    if scale >= 1.0 {
        return None;
    }
    let loses = |vertices: [Vec3; 3]| vertices.into_iter().any(|p| p * scale / scale != p);
    let count = scene.triangle_count();
    let is_hittable = |i: usize| scene.drop_reason(i).is_none();
    let given = |i: usize| if is_hittable(i) { scene.vertices(i) } else { [Vec3::ZERO; 3] };
    let is_any = parallel::any_number(count, |i| loses(scene.vertices(i)) && is_hittable(i));
    is_any.then(|| parallel::map_numbers(count, given))
}

/// What is traced, in tracing space.
pub(super) struct TracingSpace {
    /// World units times this.
    pub scale: f32,
    /// The box around all that can be hit.
    pub bounds: Aabb,
    /// Of all triangles; zeros for those that cannot be hit. None where these are in objects.
    pub triangles: Vec<[Vec3; 3]>,
    /// The triangles that can be hit. None where these are in objects.
    pub primitives: Vec<u32>,
}

impl TracingSpace {
    /// Of a scene without instances.
    pub fn of_triangles(scene: &Scene) -> TracingSpace {
        let primitives = scene.hittable();
        let (scale, bounds) = Self::scale_and_bounds(scene.bounds_of(&primitives));
        let mut triangles = vec![[Vec3::ZERO; 3]; scene.triangles.len()];
        // No coordinate is a negative zero: the sum of one and zero is not.
        primitives.iter().for_each(|&i| triangles[i as usize] = scene.vertices(i as usize).map(|p| p * scale + 0.0));
        TracingSpace { scale, bounds, triangles, primitives }
    }

    /// Of a scene whose triangles stay in the coordinates of their objects.
    pub fn of_objects(scene: &Scene) -> TracingSpace {
        let (scale, bounds) = Self::scale_and_bounds(scene.bounds());
        TracingSpace { scale, bounds, triangles: Vec::new(), primitives: Vec::new() }
    }

    /// Without a triangle that can be hit every ray misses; any box will do.
    fn scale_and_bounds(world: Option<(Vec3, Vec3)>) -> (f32, Aabb) {
        let (low, high) = world.unwrap_or_default();
        let scale = tracing_scale(low, high);
        (scale, Aabb { low: low * scale, high: high * scale })
    }
}
