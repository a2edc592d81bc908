// Embree 3 (Wald et al., "Embree: A Kernel Framework for Efficient CPU Ray Tracing", ACM Transactions on Graphics 33,
// 2014) on rays of `raybrook study pareto`. tracer.h tells how it is called. Modes: a name of "default" or "robust"
// (RTC_SCENE_FLAG_ROBUST), and "1" (rtcIntersect1, rtcOccluded1) or "16" (rtcIntersect16, rtcOccluded16, coherent).
#include "tracer.h"
#include <embree3/rtcore.h>
#include <pmmintrin.h>
#include <xmmintrin.h>

// A context that knows the triangle that a second ray leaves.
struct Context {
    RTCIntersectContext context;
    unsigned left;
};

static void leave_out(const RTCFilterFunctionNArguments* arguments) {
    const unsigned left = reinterpret_cast<const Context*>(arguments->context)->left;
    if (arguments->valid[0] == -1 && RTCHitN_primID(arguments->hit, arguments->N, 0) == left) arguments->valid[0] = 0;
}

struct Embree {
    const Rays& rays;
    const bool any_hit, packets;
    bool all_valid = true;
    RTCDevice device;
    RTCScene scene;

    static std::string version() { return RTC_VERSION_STRING; }

    Embree(const Mesh& mesh, const Rays& rays, bool any_hit, int threads, const std::string& mode)
        : rays(rays), any_hit(any_hit), packets(mode.ends_with("16")) {
        device = rtcNewDevice(("threads=" + std::to_string(threads)).c_str());
        if (!device) throw std::runtime_error("Embree has no device");
        scene = rtcNewScene(device);
        int flags = mode.starts_with("robust") ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE;
        // Costs time: only where there are second rays, which are not timed.
        if (!rays.next.empty()) flags |= RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION;
        rtcSetSceneFlags(scene, RTCSceneFlags(flags));
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
        RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        const auto buffer = [&](RTCBufferType type, RTCFormat format, size_t count) {
            return rtcSetNewGeometryBuffer(geometry, type, 0, format, 12, count);
        };
        void* vertices = buffer(RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, mesh.vertices.size());
        std::copy(mesh.vertices.begin(), mesh.vertices.end(), static_cast<Vec*>(vertices));
        void* triangles = buffer(RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, mesh.count());
        std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<uint32_t*>(triangles));
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
        rtcReleaseGeometry(geometry);
        rtcCommitScene(scene);
        if (rtcGetDeviceError(device) != RTC_ERROR_NONE) throw std::runtime_error("Embree reports an error");
        for (const Ray& ray : rays.first) all_valid = all_valid && is_valid(ray);
    }
    ~Embree() {
        rtcReleaseScene(scene);
        rtcReleaseDevice(device);
    }

    // Embree ends the program at rays that it does not take, where it is built with assertions, as Debian's is: numbers
    // above FLT_LARGE of its common/math/constants.h, and limits that are none. Here they miss. Hits behind the origin
    // (t_min below 0) it does not find: t begins at 0.
    static bool is_valid(const Ray& ray) {
        constexpr float LARGEST = 1.844e18f;
        const auto is_small = [](Vec p) {
            return std::fabs(p.x) <= LARGEST && std::fabs(p.y) <= LARGEST && std::fabs(p.z) <= LARGEST;
        };
        return is_ray(ray) && ray.t_max >= 0 && is_small(ray.origin) && is_small(ray.direction);
    }
    bool is_taken(const Ray& ray) const { return all_valid || is_valid(ray); }

    // As Embree's manual recommends it ("MXCSR control and status register").
    static void prepare_thread() {
        _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
        _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
    }

    void trace(size_t begin, size_t end, Answer* answers) const {
        prepare_thread();
        packets ? trace_packets(begin, end, answers) : trace_single(begin, end, answers);
    }

    static RTCRayHit record(const Ray& ray) {
        RTCRayHit h;
        const Vec o = ray.origin, d = ray.direction;
        h.ray = {o.x, o.y, o.z, std::max(ray.t_min, 0.0f), d.x, d.y, d.z, 0, ray.t_max, unsigned(-1), 0, 0};
        h.hit.geomID = h.hit.primID = h.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        return h;
    }

    static Answer answer(const RTCRayHit& h) {
        return h.hit.geomID == RTC_INVALID_GEOMETRY_ID ? MISS : Answer{h.ray.tfar, h.hit.u, h.hit.v, h.hit.primID};
    }

    // rtcOccluded does not tell which triangle, nor where.
    static Answer occluded(float t_far, const Ray& ray) {
        return t_far < 0 && ray.t_max >= 0 ? Answer{0, 0, 0, 0} : MISS;
    }

    void trace_single(size_t begin, size_t end, Answer* answers) const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        for (size_t i = begin; i < end; i++) {
            RTCRayHit h = record(rays.first[i]);
            if (!is_taken(rays.first[i])) {
                answers[i] = MISS;
            } else if (any_hit) {
                rtcOccluded1(scene, &context, &h.ray);
                answers[i] = occluded(h.ray.tfar, rays.first[i]);
            } else {
                rtcIntersect1(scene, &context, &h);
                answers[i] = answer(h);
            }
        }
    }

    void trace_packets(size_t begin, size_t end, Answer* answers) const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        alignas(64) int valid[16];
        for (size_t i = begin; i < end; i += 16) {
            RTCRayHit16 h;
            for (size_t k = 0; k < 16; k++) {
                const Ray& ray = rays.first[std::min(i + k, end - 1)];
                valid[k] = i + k < end && is_taken(ray) ? -1 : 0;
                const Vec o = ray.origin, d = ray.direction;
                h.ray.org_x[k] = o.x, h.ray.org_y[k] = o.y, h.ray.org_z[k] = o.z;
                h.ray.dir_x[k] = d.x, h.ray.dir_y[k] = d.y, h.ray.dir_z[k] = d.z;
                h.ray.tnear[k] = std::max(ray.t_min, 0.0f), h.ray.tfar[k] = ray.t_max;
                h.ray.time[k] = 0, h.ray.mask[k] = -1, h.ray.id[k] = 0, h.ray.flags[k] = 0;
                h.hit.geomID[k] = h.hit.primID[k] = h.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
            }
            any_hit ? rtcOccluded16(valid, scene, &context, &h.ray) : rtcIntersect16(valid, scene, &context, &h);
            for (size_t k = 0; k < 16 && i + k < end; k++) {
                const bool is_miss = !valid[k] || h.hit.geomID[k] == RTC_INVALID_GEOMETRY_ID;
                if (any_hit) answers[i + k] = occluded(h.ray.tfar[k], rays.first[i + k]);
                else answers[i + k] = is_miss ? MISS : Answer{h.ray.tfar[k], h.hit.u[k], h.hit.v[k], h.hit.primID[k]};
            }
        }
    }

    Answer second(const Ray& ray, unsigned left) const {
        if (!is_valid(ray)) return MISS;
        prepare_thread();
        Context context;
        rtcInitIntersectContext(&context.context);
        context.context.filter = leave_out;
        context.left = left;
        RTCRayHit h = record(ray);
        rtcIntersect1(scene, &context.context, &h);
        return answer(h);
    }
};

int main(int argc, char** argv) { return run<Embree>(argc, argv); }
