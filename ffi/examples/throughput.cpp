// throughput.cpp - what lookups cost: nanoseconds per point for more and more records, on one
// thread, on two, and on two while a third one fills.
//
// Times are CPU times of the asking threads, so that other programs on the machine do not count.
// Threads that waited for each other would show in the wall time per CPU time.
#include <lumicache.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
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

// The inside of a sphere that reflects light 1 from everywhere: a host that answers at once.
int32_t shell(void *, lumi_ray_batch *batch) {
    for (uint32_t i = 0; i < batch->n; i++) {
        const float *o = batch->origin + 3 * i, *d = batch->dir + 3 * i;
        const float half = o[0] * d[0] + o[1] * d[1] + o[2] * d[2];
        const float c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - 1;
        batch->distance[i] = std::fmax(0.f, -half + std::sqrt(std::fmax(0.f, half * half - c)));
        batch->radiance[3 * i] = batch->radiance[3 * i + 1] = batch->radiance[3 * i + 2] = 1;
    }
    return 0;
}

struct Points {
    std::vector<float> position, normal;
    std::size_t count;
    Points(std::size_t n, float z0, float z1) : position(3 * n), normal(3 * n), count(n) {
        for (std::size_t i = 0; i < n; i++) {
            // A walk that jumps about, as the rays of a renderer do.
            const double u = std::fmod(i * 0.7548776662466927, 1);
            const double z = z0 + (z1 - z0) * u, r = std::sqrt(1 - z * z);
            const double phi = 6.283185307179586 * std::fmod(i * 0.5698402909980532, 1);
            const float p[3] = {float(r * std::cos(phi)), float(r * std::sin(phi)), float(z)};
            for (int k = 0; k < 3; k++) position[3 * i + k] = p[k], normal[3 * i + k] = -p[k];
        }
    }
    lumi_query query() const {
        lumi_query q{};
        q.struct_size = sizeof q;
        q.n = count;
        q.position = position.data(), q.normal = normal.data();
        return q;
    }
};

double cpu_seconds() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

// CPU nanoseconds per point of a query.
double ask(lumi_cache cache, const Points &points) {
    std::vector<float> irradiance(3 * points.count);
    lumi_query q = points.query();
    q.irradiance = irradiance.data();
    const double start = cpu_seconds();
    check(lumi_cache_query(cache, &q));
    return 1e9 * (cpu_seconds() - start) / points.count;
}

lumi_stats stats(lumi_cache cache) {
    lumi_stats s{};
    s.struct_size = sizeof s;
    check(lumi_cache_get_stats(cache, &s));
    return s;
}

lumi_cache cache_of_radius(lumi_scene scene, float radius) {
    lumi_cache cache;
    check(lumi_cache_new(scene, "ward88", &cache));
    check(lumi_cache_set_i32(cache, "gather.rays", 16));
    check(lumi_cache_set_i32(cache, "levels", 1));
    check(lumi_cache_set_f32(cache, "radius.min_pixels", 0));
    // A fraction of the diagonal.
    check(lumi_cache_set_f32(cache, "radius.max_radius", radius / 3.4641f));
    return cache;
}

} // namespace

int main(int argc, char **argv) try {
    const std::size_t million = 1000000;
    const float smallest = argc > 1 ? std::stof(argv[1]) : 0.0025f;
    lumi_device device;
    lumi_scene scene;
    check(lumi_device_new(LUMI_ABI_VERSION, "threads=1", &device));
    check(lumi_scene_new(device, &scene));
    lumi_host_desc host{};
    host.struct_size = sizeof host;
    host.flags = LUMI_HOST_CONCURRENT | LUMI_HOST_FULL;
    for (int k = 0; k < 3; k++) host.bounds_min[k] = -1, host.bounds_max[k] = 1;
    host.trace = shell;
    check(lumi_scene_set_host(scene, &host));
    check(lumi_scene_commit(scene));

    const Points points(million, -1, 1);
    for (float radius = 0.08f; radius >= smallest; radius *= 0.5f) {
        lumi_cache cache = cache_of_radius(scene, radius);
        const Points seeds(std::size_t(24 / (radius * radius)), -1, 1);
        lumi_query q = seeds.query();
        check(lumi_cache_build(cache, &q));
        ask(cache, points); // warm
        const auto records = (unsigned long long)stats(cache).records;
        std::printf("%8llu records: %6.1f ns per point\n", records, ask(cache, points));
        std::fflush(stdout);
        lumi_cache_release(cache);
    }

    // Readers of the upper half while the lower half is filled.
    lumi_cache cache = cache_of_radius(scene, 0.01f);
    const Points upper(million, 0.05f, 1);
    const Points seeds(200000, 0, 1);
    lumi_query q = seeds.query();
    check(lumi_cache_build(cache, &q));
    auto readers = [&](int count, const char *what) {
        std::vector<double> cost(count);
        std::vector<std::thread> threads;
        const auto start = std::chrono::steady_clock::now();
        for (int t = 0; t < count; t++)
            threads.emplace_back([&, t] {
                for (int i = 0; i < 4; i++) cost[t] += ask(cache, upper) / 4;
            });
        for (auto &t : threads) t.join();
        const auto end = std::chrono::steady_clock::now();
        const double wall = std::chrono::duration<double>(end - start).count();
        double rate = 0;
        for (double c : cost) rate += 1e3 / c;
        std::printf("%-32s %6.1f ns per point, %6.2f million points per CPU s, %6.2f per s\n", what,
                    cost[0], rate, 4 * count / wall);
        std::fflush(stdout);
        return rate;
    };
    readers(1, "warm");
    const double one = readers(1, "one thread");
    const double two = readers(2, "two threads");
    bool stop = false;
    std::thread filler([&] {
        for (int k = 0; k < 400 && !__atomic_load_n(&stop, __ATOMIC_RELAXED); k++) {
            const Points strip(2000, -k / 400.f - 0.0025f, -k / 400.f);
            lumi_query fill = strip.query();
            fill.flags = LUMI_QUERY_FILL;
            check(lumi_cache_query(cache, &fill));
        }
    });
    const std::size_t before = stats(cache).records;
    const double during = readers(2, "two threads while a third fills");
    __atomic_store_n(&stop, true, __ATOMIC_RELAXED);
    filler.join();
    std::printf("records %zu -> %llu; two threads %.2f of one, %.2f while filling\n", before,
                (unsigned long long)stats(cache).records, two / one, during / one);
    lumi_cache_release(cache);
    lumi_scene_release(scene);
    lumi_device_release(device);
    return 0;
} catch (const std::exception &error) {
    std::fprintf(stderr, "throughput: %s\n", error.what());
    return 1;
}
