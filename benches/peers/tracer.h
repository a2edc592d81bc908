// What the programs of this folder have in common: files of rays and meshes in, answers out, passes on command.
// crates/lab/src/study/peers/README.md describes the files.
//
//   PROGRAM MESH RAYS ANSWERS closest|any THREADS MODE
//
// It reads, builds, traces once (the warm-up, which writes ANSWERS), and says "ready"; then for each line on standard
// input it traces all rays once and says how many seconds that took, so that several programs can be timed by turns.
// A pass is the whole of it: from the arrays of rays to the array of answers, on THREADS threads that wait for it.
#pragma once
#include <algorithm>
#include <atomic>
#include <barrier>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

struct Vec { float x, y, z; };
struct Ray { Vec origin; float t_min; Vec direction; float t_max; };
struct Answer { float t, u, v; uint32_t triangle; };
static_assert(sizeof(Ray) == 32 && sizeof(Answer) == 16);

constexpr uint32_t NONE = 0xffffffffu;
constexpr Answer MISS = {std::numeric_limits<float>::infinity(), 0, 0, NONE};

inline bool is_finite(Vec p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); }
// What the rays' files call no ray.
inline bool is_ray(const Ray& ray) {
    const Vec d = ray.direction;
    return is_finite(ray.origin) && is_finite(d) && (d.x != 0 || d.y != 0 || d.z != 0) && ray.t_min <= ray.t_max;
}

struct Mesh {
    std::vector<Vec> vertices;
    std::vector<uint32_t> triangles; // three each
    size_t count() const { return triangles.size() / 3; }
    Vec corner(size_t triangle, int k) const { return vertices[triangles[3 * triangle + k]]; }
};

struct Rays {
    std::vector<Ray> first;
    std::vector<Vec> next; // directions of second rays, or none
};

class File {
    FILE* file;
    std::string path;
  public:
    File(const std::string& path, const char* mode) : file(fopen(path.c_str(), mode)), path(path) {
        if (!file) throw std::runtime_error("cannot open " + path);
    }
    ~File() { fclose(file); }
    template <class T> std::vector<T> read(size_t count) {
        std::vector<T> data(count);
        if (count && fread(data.data(), sizeof(T), count, file) != count)
            throw std::runtime_error(path + " is cut short");
        return data;
    }
    template <class T> void write(const std::vector<T>& data) {
        if (!data.empty() && fwrite(data.data(), sizeof(T), data.size(), file) != data.size())
            throw std::runtime_error("cannot write " + path);
    }
};

inline Mesh read_mesh(const std::string& path) {
    File file(path, "rb");
    const auto counts = file.read<uint32_t>(2);
    Mesh mesh;
    mesh.vertices = file.read<Vec>(counts[0]);
    mesh.triangles = file.read<uint32_t>(3 * size_t(counts[1]));
    return mesh;
}

inline Rays read_rays(const std::string& path) {
    File file(path, "rb");
    const auto counts = file.read<uint32_t>(2);
    Rays rays;
    rays.first = file.read<Ray>(counts[0]);
    if (counts[1]) rays.next = file.read<Vec>(counts[0]);
    return rays;
}

// Where a second ray starts: at the point that the hit's weights name, moved off the plane to the side that the ray
// goes to, by the bound of that point's rounding errors (Pharr, Jakob, Humphreys, "Physically Based Rendering", 3rd
// edition, 2016, sections 3.9.4 and 3.9.5), so that neighbours of the triangle are left, too.
inline Vec start_of_second(const Mesh& mesh, const Answer& hit, Vec direction) {
    constexpr double EPSILON = 0x1p-24, GAMMA7 = 7 * EPSILON / (1 - 7 * EPSILON);
    const Vec a = mesh.corner(hit.triangle, 0), b = mesh.corner(hit.triangle, 1), c = mesh.corner(hit.triangle, 2);
    const float weights[] = {1 - hit.u - hit.v, hit.u, hit.v};
    const float x[3][3] = {{a.x, b.x, c.x}, {a.y, b.y, c.y}, {a.z, b.z, c.z}};
    double e1[3], e2[3], normal[3];
    for (int k = 0; k < 3; k++) e1[k] = double(x[k][1]) - x[k][0], e2[k] = double(x[k][2]) - x[k][0];
    for (int k = 0; k < 3; k++) normal[k] = e1[(k + 1) % 3] * e2[(k + 2) % 3] - e1[(k + 2) % 3] * e2[(k + 1) % 3];
    const double length = std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    double by = 0;
    float point[3];
    for (int k = 0; k < 3; k++) {
        normal[k] = length > 0 ? normal[k] / length : 0;
        double size = 0;
        for (int i = 0; i < 3; i++) size += std::fabs(double(weights[i]) * x[k][i]);
        by += std::fabs(normal[k]) * GAMMA7 * size;
    }
    const bool is_behind = direction.x * normal[0] + direction.y * normal[1] + direction.z * normal[2] < 0;
    for (int k = 0; k < 3; k++) {
        const float on = weights[0] * x[k][0] + weights[1] * x[k][1] + weights[2] * x[k][2];
        const double offset = (is_behind ? -by : by) * normal[k];
        point[k] = float(on + offset);
        // Away from the plane, where the sum was rounded.
        if (offset != 0) point[k] = std::nextafter(point[k], offset > 0 ? INFINITY : -INFINITY);
    }
    return {point[0], point[1], point[2]};
}

// Threads that wait for work, this one among them.
class Pool {
    std::barrier<> start, done;
    std::vector<std::thread> others;
    std::atomic<size_t> next{0};
    size_t count = 0;
    bool is_over = false;
    // Takes rays first to last - 1; set for each pass.
    std::atomic<void (*)(void*, size_t, size_t)> work{nullptr};
    void* data = nullptr;

    void help() {
        constexpr size_t CHUNK = 1024; // small against a pass, large against taking a number
        for (size_t begin; (begin = next.fetch_add(CHUNK)) < count;)
            work.load()(data, begin, std::min(count, begin + CHUNK));
    }

  public:
    explicit Pool(int threads) : start(threads), done(threads) {
        for (int i = 1; i < threads; i++) others.emplace_back([this] {
            for (;;) {
                start.arrive_and_wait();
                if (is_over) return;
                help();
                done.arrive_and_wait();
            }
        });
    }
    ~Pool() {
        is_over = true;
        start.arrive_and_wait();
        for (auto& thread : others) thread.join();
    }
    template <class F> void run(size_t rays, F& f) {
        next = 0, count = rays, data = &f;
        work = [](void* f, size_t begin, size_t end) { (*static_cast<F*>(f))(begin, end); };
        start.arrive_and_wait();
        help();
        done.arrive_and_wait();
    }
};

// Tracer has: Tracer(mesh, rays, any_hit, threads, mode), trace(begin, end, answers), second(ray, left triangle), and
// version().
template <class Tracer> int run(int argc, char** argv) try {
    if (argc != 7) throw std::runtime_error("usage: PROGRAM MESH RAYS ANSWERS closest|any THREADS MODE");
    const Mesh mesh = read_mesh(argv[1]);
    const Rays rays = read_rays(argv[2]);
    const bool any_hit = std::string(argv[4]) == "any";
    const int threads = std::max(1, atoi(argv[5]));
    Tracer tracer(mesh, rays, any_hit, threads, argv[6]);
    Pool pool(threads);
    std::vector<Answer> answers(rays.first.size(), MISS);
    auto trace = [&](size_t begin, size_t end) { tracer.trace(begin, end, answers.data()); };
    pool.run(rays.first.size(), trace);
    std::vector<Answer> next(rays.next.size(), MISS);
    for (size_t i = 0; i < next.size(); i++) {
        const Answer& hit = answers[i];
        if (hit.triangle == NONE) continue;
        const Vec along = rays.next[i];
        const Ray ray = {start_of_second(mesh, hit, along), 0, along, std::numeric_limits<float>::infinity()};
        if (is_ray(ray)) next[i] = tracer.second(ray, hit.triangle);
    }
    {
        File file(argv[3], "wb");
        file.write(answers);
        file.write(next);
    }
    std::cout << "ready " << Tracer::version() << std::endl;
    for (std::string line; std::getline(std::cin, line);) {
        const auto before = std::chrono::steady_clock::now();
        pool.run(rays.first.size(), trace);
        const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - before;
        std::cout.precision(9);
        std::cout << seconds.count() << std::endl;
    }
    return 0;
} catch (const std::exception& error) {
    std::cerr << argv[0] << ": " << error.what() << "\n";
    return 1;
}
