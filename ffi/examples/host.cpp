// host.cpp - the library from C++17: handles that release themselves, errors as exceptions, a glTF
// scene, and threads that look up while another one fills.
//
//   host scene.gltf
#include <lumicache.h>
#include <lumicache.h> // may be included twice

#include <cstdio>
#include <memory>
#include <random>
#include <stdexcept>
#include <thread>
#include <vector>

namespace {

void check(lumi_error code) {
    if (code == LUMI_OK) return;
    const char *message = nullptr;
    lumi_get_last_error(&message);
    throw std::runtime_error(message);
}

template <typename Handle, void (*release)(Handle)> struct Release {
    using pointer = Handle;
    void operator()(Handle handle) const { release(handle); }
};
using Device = std::unique_ptr<lumi_device_s, Release<lumi_device, lumi_device_release>>;
using Scene = std::unique_ptr<lumi_scene_s, Release<lumi_scene, lumi_scene_release>>;
using Cache = std::unique_ptr<lumi_cache_s, Release<lumi_cache, lumi_cache_release>>;

struct Point {
    float position[3], normal[3], geo_normal[3], albedo[3];
};

// Points of surfaces that random rays from the middle of the scene meet.
std::vector<Point> look_around(lumi_scene scene, std::size_t count) {
    lumi_scene_info info{};
    info.struct_size = sizeof info;
    check(lumi_scene_get_info(scene, &info));
    std::vector<float> origin, dir;
    std::mt19937 random(1);
    std::normal_distribution<float> gauss;
    for (std::size_t i = 0; i < 3 * count; i++) {
        origin.push_back(0.5f * (info.bounds_min[i % 3] + info.bounds_max[i % 3]));
        dir.push_back(gauss(random));
    }
    std::vector<float> distance(count), position(3 * count), normal(3 * count), geo(3 * count);
    std::vector<float> albedo(3 * count);
    lumi_trace_desc rays{};
    rays.struct_size = sizeof rays;
    rays.n = count;
    rays.origin = origin.data(), rays.dir = dir.data();
    rays.distance = distance.data(), rays.position = position.data(), rays.normal = normal.data();
    rays.geo_normal = geo.data(), rays.albedo = albedo.data();
    check(lumi_scene_trace(scene, &rays));
    std::vector<Point> points;
    for (std::size_t i = 0; i < count; i++) {
        if (albedo[3 * i] <= 0) continue;
        Point p;
        for (int k = 0; k < 3; k++) {
            p.position[k] = position[3 * i + k], p.normal[k] = normal[3 * i + k];
            p.geo_normal[k] = geo[3 * i + k], p.albedo[k] = albedo[3 * i + k];
        }
        points.push_back(p);
    }
    return points;
}

// A query over an array of structs: strides tell where the vectors are.
lumi_query query(const Point *points, std::size_t count, float *irradiance, std::uint8_t *status) {
    lumi_query q{};
    q.struct_size = sizeof q;
    q.n = count;
    q.position = points->position, q.position_stride = sizeof(Point);
    q.normal = points->normal, q.normal_stride = sizeof(Point);
    q.geo_normal = points->geo_normal, q.geo_normal_stride = sizeof(Point);
    q.irradiance = irradiance, q.status = status;
    return q;
}

} // namespace

int main(int argc, char **argv) try {
    if (argc != 2) throw std::runtime_error("usage: host scene.gltf");
    lumi_device d;
    check(lumi_device_new(LUMI_ABI_VERSION, "threads=2", &d));
    Device device(d);
    lumi_scene s;
    check(lumi_scene_new(device.get(), &s));
    Scene scene(s);
    check(lumi_scene_load_gltf(scene.get(), argv[1]));
    check(lumi_scene_commit(scene.get()));
    lumi_cache c;
    check(lumi_cache_new(scene.get(), "auto", &c));
    Cache cache(c);
    check(lumi_cache_set_i32(cache.get(), "gather.rays", 64));
    check(lumi_cache_set_i32(cache.get(), "levels", 1));

    const std::vector<Point> points = look_around(scene.get(), 4000);
    if (points.empty()) throw std::runtime_error("the scene has no diffuse surfaces");
    device.reset(), scene.reset(); // the cache keeps what it needs

    // Two threads ask for all points, each from its end, and fill the missing ones; a third one
    // looks up.
    auto ask = [&](std::size_t begin, std::size_t end, std::uint32_t flags) {
        std::vector<float> irradiance(3 * (end - begin));
        lumi_query q = query(points.data() + begin, end - begin, irradiance.data(), nullptr);
        q.flags = flags;
        check(lumi_cache_query(cache.get(), &q));
    };
    const std::size_t half = points.size() / 2;
    std::thread first([&] { ask(0, half, LUMI_QUERY_FILL); });
    std::thread second([&] { ask(half, points.size(), LUMI_QUERY_FILL); });
    std::thread reader([&] { for (int i = 0; i < 20; i++) ask(0, points.size(), 0); });
    first.join(), second.join(), reader.join();
    check(lumi_cache_freeze(cache.get()));

    std::vector<float> irradiance(3 * points.size());
    std::vector<std::uint8_t> status(points.size());
    lumi_query q = query(points.data(), points.size(), irradiance.data(), status.data());
    check(lumi_cache_query(cache.get(), &q));
    std::size_t missing = 0;
    double mean = 0;
    for (std::size_t i = 0; i < points.size(); i++) {
        missing += status[i] != LUMI_POINT_INTERPOLATED;
        mean += irradiance[3 * i + 1] / double(points.size());
    }
    lumi_stats stats{};
    stats.struct_size = sizeof stats;
    check(lumi_cache_get_stats(cache.get(), &stats));
    std::printf("%zu points, %zu missing, %llu records, mean irradiance %.4f\n", points.size(),
                missing, static_cast<unsigned long long>(stats.records), mean);
    if (missing > points.size() / 100 || !(mean > 0))
        throw std::runtime_error("the points are not covered");
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "host: %s\n", error.what());
    return 1;
}
