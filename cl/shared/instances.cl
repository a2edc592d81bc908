// Triangles of objects that stand in the scene many times, placed when they are read (src/pack/instances.rs; with
// INSTANCES alone). `vertices` and `shading` have each object once, in its own coordinates; the macros of cl/memory/
// lead here, so that whatever knows a triangle by its number in the scene gets it where the instance is, with the bits
// that placing it beforehand would have given.
//
// Who reads a triangle mostly reads another one of the same instance next: its transform is kept in the Geometry's
// Placed.
#ifdef INSTANCES

float row_times_point(float4 row, float3 p) { return fma(row.x, p.x, fma(row.y, p.y, fma(row.z, p.z, row.w))); }
float row_times_direction(float4 row, float3 d) { return fma(row.x, d.x, fma(row.y, d.y, row.z * d.z)); }

// The number in w of a record of an instance.
uint instance_number(GEOMETRY_PARAMETERS, uint instance, uint record) {
    return as_uint(BOUNDS_RECORD(geometry, INSTANCE_RECORDS * instance + record).w);
}

// The instance that has a triangle: the last one that begins no later. Instances are in the order of their triangles.
uint instance_at(GEOMETRY_PARAMETERS, uint primitive) {
    uint low = 0, high = geometry->reference_count;
    while (high - low > 1u) {
        const uint middle = low + (high - low) / 2u;
        const bool is_later = instance_number(GEOMETRY, middle, INSTANCE_NORMALS) > primitive;
        low = is_later ? low : middle;
        high = is_later ? middle : high;
    }
    return low;
}

// Makes *geometry->placed that of a triangle.
void place(GEOMETRY_PARAMETERS, uint primitive) {
    Placed* placed = geometry->placed;
    if (primitive - placed->first < placed->count) return;
    const uint instance = instance_at(GEOMETRY, primitive);
    placed->instance = instance;
    placed->first = instance_number(GEOMETRY, instance, INSTANCE_NORMALS);
    placed->count = instance_number(GEOMETRY, instance, INSTANCE_NORMALS + 1u);
    placed->to_slot = instance_number(GEOMETRY, instance, INSTANCE_NORMALS + 2u);
    placed->row0 = BOUNDS_RECORD(geometry, INSTANCE_RECORDS * instance + INSTANCE_TO_WORLD);
    placed->row1 = BOUNDS_RECORD(geometry, INSTANCE_RECORDS * instance + INSTANCE_TO_WORLD + 1u);
    placed->row2 = BOUNDS_RECORD(geometry, INSTANCE_RECORDS * instance + INSTANCE_TO_WORLD + 2u);
}

// No coordinate is a negative zero.
float3 positive_zeros(float3 v) { return (float3)(positive_zero(v.x), positive_zero(v.y), positive_zero(v.z)); }

float3 placed_vertex(GEOMETRY_PARAMETERS, uint primitive, uint corner) {
    place(GEOMETRY, primitive);
    const Placed* placed = geometry->placed;
    const float3 p = VERTEX_RECORD(geometry, VERTEX_STRIDE * (primitive + placed->to_slot) + corner).xyz;
    const float3 world =
        (float3)(row_times_point(placed->row0, p), row_times_point(placed->row1, p), row_times_point(placed->row2, p));
    return positive_zeros(world * geometry->scale);
}

float3 unit_normal(float3 n) { return positive_zeros(normalize3(n, (float3)(0.0f))); }
bool is_zero3(float3 v) { return v.x == 0.0f && v.y == 0.0f && v.z == 0.0f; }

// A normal of an object as the rows of an instance have it.
float3 placed_normal(float4 row0, float4 row1, float4 row2, float3 n) {
    return unit_normal(
        (float3)(row_times_direction(row0, n), row_times_direction(row1, n), row_times_direction(row2, n)));
}

Shading placed_shading(GEOMETRY_PARAMETERS, __global const Shading* shading, uint primitive) {
    place(GEOMETRY, primitive);
    const Placed* placed = geometry->placed;
    Shading at = SHADING_RECORD(shading, primitive + placed->to_slot);
    if (HAS(FEATURE_SMOOTH_NORMALS)) {
        const uint first = INSTANCE_RECORDS * placed->instance + INSTANCE_NORMALS;
        const float4 row0 = BOUNDS_RECORD(geometry, first);
        const float4 row1 = BOUNDS_RECORD(geometry, first + 1u);
        const float4 row2 = BOUNDS_RECORD(geometry, first + 2u);
        const float3 n0 = placed_normal(row0, row1, row2, at.normal0_u0.xyz);
        const float3 n1 = placed_normal(row0, row1, row2, at.normal1_u1.xyz);
        const float3 n2 = placed_normal(row0, row1, row2, at.normal2_u2.xyz);
        // A corner without a normal: the whole triangle is flat.
        const bool is_flat = is_zero3(n0) || is_zero3(n1) || is_zero3(n2);
        at.normal0_u0.xyz = is_flat ? (float3)(0.0f) : n0;
        at.normal1_u1.xyz = is_flat ? (float3)(0.0f) : n1;
        at.normal2_u2.xyz = is_flat ? (float3)(0.0f) : n2;
    }
    if (HAS(FEATURE_SEVERAL_MATERIALS)) {
        const uint material = instance_number(GEOMETRY, placed->instance, INSTANCE_BLUR);
        if (material != NO_MATERIAL) at.material = material;
    }
    return at;
}

uint placed_material(GEOMETRY_PARAMETERS, __global const Shading* shading, uint primitive) {
    place(GEOMETRY, primitive);
    const uint material = instance_number(GEOMETRY, geometry->placed->instance, INSTANCE_BLUR);
    return material != NO_MATERIAL ? material : MATERIAL_RECORD(shading, primitive + geometry->placed->to_slot);
}
#endif
