// What kernels trace a ray by: the traversal, whichever it is (TRAVERSE), and then what it has left open; rays of
// batches do the same in two steps (batch.cl). The signature is that of the traversals (leaf.cl).
ONE_COPY bool trace_ray(GEOMETRY_PARAMETERS, const Ray* ray, const bool any_hit, Hit* hit) {
    const bool found = TRAVERSE(GEOMETRY, ray, any_hit, hit);
    return SETTLE(GEOMETRY, ray, any_hit, hit) || found;
}
