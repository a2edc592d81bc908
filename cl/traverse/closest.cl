// The closest hit of a ray, with t, u and v in full. False when there is none.
bool closest_hit(GEOMETRY_PARAMETERS, const Ray* ray, Hit* hit) {
    if (!TRAVERSE(GEOMETRY, ray, false, hit)) return false;
    FINISH(GEOMETRY, ray, hit);
    return true;
}
