// Uniform grid, walked cell by cell.
// Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987; thesis, sections 2.2.3 and
// 5.1.
//
// Of all structures the quickest to build, and right for triangles of about one size spread evenly. Bad at everything
// else: a small detailed object in a large scene (the "teapot in the stadium") falls into one cell, and rays pay for
// every empty cell. A triangle in several cells is tested again in each: no mailboxes.
//
// nodes[cell] is a leaf record, cells in order z, y, x (x fastest). bounds[0] {low corner, cells along x}, bounds[1] {a
// cell's size, cells along y}, bounds[2] {1 / size, cells along z}, bounds[3] {reach, first of the list of all
// triangles, how many of these, the first ones, are outside of the grid, 0}, bounds[4] the high corner; whole numbers
// by as_int and as_uint. The list of all triangles ends the references. Outside are those that reach so far out that
// all others would be in one cell (src/accel/near.rs).
//
// The walk does not accumulate t as the paper does: plane k of an axis is ONE float32 number, fma(k, size, low), here
// and in src/accel/grid.rs, and its t comes from it. Why no triangle is missed, with D as in cl/shared/ray.cl:
// - Each axis crosses its planes at computed times that do not decrease, and each such t is off by so little that the
//   ray is within 5 EPSILON D of the plane then. The start is off by 6 EPSILON D at most. So at every time t of the
//   walk, whatever the order in which planes of equal t are crossed, the ray's point at t is within 6 EPSILON D of the
//   walk's cell of that time.
// - The point of a hit is within HIT_ERROR EPSILON D of its triangle's box. The walk's cell at the hit's t, therefore,
//   is within 38 EPSILON D of that box, and the build lists each triangle in all cells within 48 EPSILON D of its box:
//   ties, edges, corners and rays in planes need no care. Cells at the rim reach outwards without end.
// - The walk may end at the first crossing whose t is above hit->t: a nearer hit's cell was the walk's at an earlier
//   time.
// The build knows no D, so it assumes that of the farthest ray within `reach`. One from farther away tests every
// triangle.

// One axis of the walk. cell moves by step until it is last; t_next is the t of the next plane.
typedef struct {
    float low, size, origin, origin_low, inv_direction;
    int cell, last, step;
    float t_next;
} GridAxis;

float grid_plane(const GridAxis* axis, int k) { return fma((float)k, axis->size, axis->low); }

// t of the plane between the cell and the next one; infinity at the rim and for a ray along the planes.
float grid_next_t(const GridAxis* axis) {
    if (axis->cell == axis->last) return INFINITY;
    return ((grid_plane(axis, axis->cell + (axis->step > 0 ? 1 : 0)) - axis->origin) - axis->origin_low) *
           axis->inv_direction;
}

void grid_step(GridAxis* axis) {
    axis->cell += axis->step;
    axis->t_next = grid_next_t(axis);
}

GridAxis grid_axis(float low, float size, float cells_per_unit, int count, float origin, float origin_low,
                   float direction, float inv_direction, float t_start) {
    GridAxis axis;
    axis.low = low;
    axis.size = size;
    axis.origin = origin;
    axis.origin_low = origin_low;
    axis.inv_direction = inv_direction;
    // The start's cell: a guess, clamped before it becomes an integer (NaN becomes 0), then moved to where the planes
    // say.
    const float from_low = fma(t_start, direction, -((low - origin) - origin_low));
    const float guess = min_or(max_or(from_low * cells_per_unit, 0.0f), (float)(count - 1));
    axis.cell = (int)guess;
    while (axis.cell > 0 && from_low < grid_plane(&axis, axis.cell) - low) axis.cell--;
    while (axis.cell < count - 1 && from_low > grid_plane(&axis, axis.cell + 1) - low) axis.cell++;
    axis.step = direction < 0.0f ? -1 : 1;
    axis.last = !is_finite(inv_direction) ? axis.cell : direction < 0.0f ? 0 : count - 1;
    axis.t_next = grid_next_t(&axis);
    return axis;
}

bool traverse_grid(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    *hit = no_hit_yet(ray);
    const float4 low = LOAD_BOUNDS(geometry, 0), high = LOAD_BOUNDS(geometry, 4);
    const float distance = farthest_distance(ray, low.xyz, high.xyz);
    const float4 reach = LOAD_BOUNDS(geometry, 3);
    if (!(distance <= reach.x)) {
        test_triangles(GEOMETRY, ray, as_uint(reach.y), geometry->reference_count, any_hit, hit);
        return hit->primitive != NO_PRIMITIVE;
    }
    const uint outside = as_uint(reach.y);
    if (test_triangles(GEOMETRY, ray, outside, outside + as_uint(reach.z), any_hit, hit)) return true;
    float t_near, t_far;
    if (!clip_to_thick_box(ray, SLACK * distance, low.xyz, high.xyz, &t_near, &t_far))
        return hit->primitive != NO_PRIMITIVE;

    const float4 size = LOAD_BOUNDS(geometry, 1);
    const float4 per_unit = LOAD_BOUNDS(geometry, 2);
    const int count_x = as_int(low.w), count_y = as_int(size.w), count_z = as_int(per_unit.w);
    GridAxis x = grid_axis(low.x, size.x, per_unit.x, count_x, ray->origin.x, ray->origin_low.x, ray->direction.x,
                           ray->inv_direction.x, t_near);
    GridAxis y = grid_axis(low.y, size.y, per_unit.y, count_y, ray->origin.y, ray->origin_low.y, ray->direction.y,
                           ray->inv_direction.y, t_near);
    GridAxis z = grid_axis(low.z, size.z, per_unit.z, count_z, ray->origin.z, ray->origin_low.z, ray->direction.z,
                           ray->inv_direction.z, t_near);
    while (true) {
        const int4 cell = LOAD_NODE(geometry, (z.cell * count_y + y.cell) * count_x + x.cell);
        if (test_leaf(GEOMETRY, ray, cell, any_hit, hit)) return true;
        const float t_next = min_or(x.t_next, min_or(y.t_next, z.t_next));
        if (!(t_next <= t_far && t_next <= hit->t)) return hit->primitive != NO_PRIMITIVE;
        COUNT(geometry, STEPS, 1);
        if (x.t_next == t_next) {
            grid_step(&x);
        } else if (y.t_next == t_next) {
            grid_step(&y);
        } else {
            grid_step(&z);
        }
    }
}
