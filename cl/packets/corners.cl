// Packets of eight triangles (src/accel/leaf_packets.rs), for packets of rays and for points.

// Reads the corners of packet number `packet` of triangles.
void load_corners(GEOMETRY_PARAMETERS, uint packet, float8* a, float8* b, float8* c) {
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const uint record = BVH8_PACKET_RECORDS * packet + 2u * axis;
        a[axis] = LOAD_PACKET(geometry, record);
        b[axis] = LOAD_PACKET(geometry, record + 6u);
        c[axis] = LOAD_PACKET(geometry, record + 12u);
    }
}

#ifdef EXTENDED_IS_DOUBLE
// The corners of the triangle of that reference.
Corners corners_of_reference(GEOMETRY_PARAMETERS, uint reference) {
    const uint record = BVH8_PACKET_RECORDS * (reference / 8u), lane = reference % 8u;
    float c[9];
#pragma unroll
    for (uint i = 0; i < 9u; i++) c[i] = LOAD_PACKET_LANE(geometry, record + 2u * i, lane);
    const Corners corners = {(float3)(c[0], c[1], c[2]), (float3)(c[3], c[4], c[5]), (float3)(c[6], c[7], c[8])};
    return corners;
}
#endif
