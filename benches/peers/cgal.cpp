// CGAL's tree of boxes (Alliez, Tayeb, Wormser, "3D Fast Intersection and Distance Computation", CGAL manual) on rays
// of `raybrook study pareto`: first_intersected_primitive, or do_intersect where any hit will do. tracer.h tells how it
// is called. Modes: "exact" (Exact_predicates_inexact_constructions_kernel) and "double" (Simple_cartesian<double>).
//
// CGAL finds the triangle; t, u and v are computed here, in doubles.
#include "tracer.h"
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/version.h>

template <class Kernel> struct Cgal {
    using Point = typename Kernel::Point_3;
    using Triangle = typename Kernel::Triangle_3;
    using Segment = typename Kernel::Segment_3;
    using Line = typename Kernel::Ray_3;
    using Iterator = typename std::vector<Triangle>::const_iterator;
    using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, CGAL::AABB_triangle_primitive<Kernel, Iterator>>>;

    const Rays& rays;
    const bool any_hit;
    std::vector<Triangle> triangles;
    std::vector<uint32_t> numbers; // of the triangles in the mesh
    Tree tree;

    static std::string version() { return CGAL_VERSION_STR; }
    static Point point(Vec p) { return {p.x, p.y, p.z}; }

    Cgal(const Mesh& mesh, const Rays& rays, bool any_hit, int, const std::string&) : rays(rays), any_hit(any_hit) {
        for (size_t i = 0; i < mesh.count(); i++) {
            const Vec corners[] = {mesh.corner(i, 0), mesh.corner(i, 1), mesh.corner(i, 2)};
            if (!is_finite(corners[0]) || !is_finite(corners[1]) || !is_finite(corners[2])) continue;
            const Triangle triangle(point(corners[0]), point(corners[1]), point(corners[2]));
            if (triangle.is_degenerate()) continue; // which its predicates do not allow
            triangles.push_back(triangle), numbers.push_back(i);
        }
        tree.insert(triangles.cbegin(), triangles.cend());
        tree.build();
    }

    // CGAL keeps a ray as two points. The second one is as far from the first as that is from zero, at least: nearer
    // ones are rounded to other directions.
    static Line line_of(const Ray& ray) {
        const auto largest = [](Vec p) { return std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)}); };
        const float from = largest(ray.origin), along = largest(ray.direction);
        const int by = from > along ? std::ilogb(from) - std::ilogb(along) : 0;
        const auto scaled = [by](float x) { return std::ldexp(double(x), by); };
        const Vec d = ray.direction;
        return {point(ray.origin), typename Kernel::Vector_3(scaled(d.x), scaled(d.y), scaled(d.z))};
    }

    // Where the ray crosses the triangle's plane; t is NaN where it runs in it.
    static Answer crossing(const Triangle& triangle, const Ray& ray, uint32_t number) {
        const Point o = point(ray.origin);
        const typename Kernel::Vector_3 d(ray.direction.x, ray.direction.y, ray.direction.z);
        const auto a = triangle[0] - o, e1 = triangle[1] - triangle[0], e2 = triangle[2] - triangle[0];
        const auto n = CGAL::cross_product(e1, e2), q = CGAL::cross_product(d, a);
        const double det = n * d;
        if (det == 0) return {NAN, 0, 0, NONE};
        return {float((n * a) / det), float(-(q * e2) / det), float((q * e1) / det), number};
    }

    // The first hit between the ray's limits that is not of triangle `left`.
    Answer closest(const Ray& ray, uint32_t left) const {
        if (!is_ray(ray)) return MISS;
        const Line line = line_of(ray);
        auto answer = [&](Iterator i) { return crossing(*i, ray, numbers[i - triangles.cbegin()]); };
        auto is_out = [&](Iterator i) {
            const Answer a = answer(i);
            return a.triangle == left || !(a.t >= ray.t_min && a.t <= ray.t_max);
        };
        const bool is_plain = left == NONE && ray.t_min == 0 && ray.t_max == std::numeric_limits<float>::infinity();
        try {
            auto found = is_plain ? tree.first_intersected_primitive(line)
                                  : tree.first_intersected_primitive(line, is_out);
            // CGAL finds triangles that the ray runs in; those do not count.
            if (found && is_plain && is_out(*found)) found = tree.first_intersected_primitive(line, is_out);
            if (!found) return MISS;
            const Answer a = answer(*found);
            return std::isfinite(a.t) ? a : MISS;
        } catch (const CGAL::Failure_exception&) {
            return MISS; // doubles contradict each other
        }
    }

    void trace(size_t begin, size_t end, Answer* answers) const {
        for (size_t i = begin; i < end; i++) {
            const Ray& ray = rays.first[i];
            // A segment from the origin, as shadow rays from the lit point to the light. Which triangle it meets is
            // not told.
            if (any_hit && ray.t_min == 0 && is_ray(ray) && std::isfinite(ray.t_max)) {
                const Vec o = ray.origin, d = ray.direction;
                const double t = ray.t_max;
                const Point to(o.x + t * d.x, o.y + t * d.y, o.z + t * d.z);
                answers[i] = tree.do_intersect(Segment(point(ray.origin), to)) ? Answer{0, 0, 0, 0} : MISS;
            } else {
                answers[i] = closest(ray, NONE);
            }
        }
    }

    Answer second(const Ray& ray, uint32_t left) const { return closest(ray, left); }
};

int main(int argc, char** argv) {
    CGAL::set_error_handler([](const char*, const char*, const char*, int, const char*) {}); // they are caught
    const bool is_exact = argc == 7 && std::string(argv[6]) == "exact";
    if (is_exact) return run<Cgal<CGAL::Exact_predicates_inexact_constructions_kernel>>(argc, argv);
    return run<Cgal<CGAL::Simple_cartesian<double>>>(argc, argv);
}
