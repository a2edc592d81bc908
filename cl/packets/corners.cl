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
