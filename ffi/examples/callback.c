/* callback.c - a renderer that keeps its scene. A tracer of spheres lends its rays and its direct
   light; the library answers with indirect light.

   The scene is a closed sphere of radius 1, seen from inside. Its surface has the albedo 0.5 and
   receives the direct irradiance pi everywhere, so the surface reflects the direct radiance 0.5.
   The indirect irradiance is then pi * (0.5 + 0.25 + 0.125 + ...) = pi. A small black ball in the
   middle takes a little of it away.

   cc -std=c99 callback.c $(pkg-config --cflags --libs lumicache) -lm -o callback && ./callback */
#include <lumicache.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define N 1000
#define BALL 0.1f /* radius of the ball */

static void check(lumi_error code) {
    const char *message;
    if (code == LUMI_OK) return;
    lumi_get_last_error(&message);
    fprintf(stderr, "error %d: %s\n", (int)code, message);
    exit(1);
}

static float dot(const float *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Nearest distance above 0 at which the ray meets the sphere around the origin; INFINITY: none. */
static float sphere(const float *o, const float *d, float radius) {
    float b = dot(o, d), c = dot(o, o) - radius * radius, q = b * b - c;
    if (q < 0) return INFINITY;
    q = sqrtf(q);
    if (-b - q > 1e-5f) return -b - q;
    return -b + q > 1e-5f ? -b + q : INFINITY;
}

static int32_t trace(void *user, lumi_ray_batch *batch) {
    uint64_t *rays = user;
    uint32_t i;
    int k;
    for (i = 0; i < batch->n; i++) {
        const float *o = batch->origin + 3 * i, *d = batch->dir + 3 * i;
        float ball = sphere(o, d, BALL), shell = sphere(o, d, 1), t = fminf(ball, shell);
        batch->distance[i] = t;
        if (t == INFINITY) continue;
        for (k = 0; k < 3; k++) {
            float p = o[k] + t * d[k];
            batch->normal[3 * i + k] = ball < shell ? p / BALL : -p;
            batch->radiance[3 * i + k] = batch->albedo[3 * i + k] = ball < shell ? 0 : 0.5f;
        }
    }
    *rays += batch->n; /* the library calls on this thread alone: LUMI_HOST_CONCURRENT is not set */
    return 0;
}

int main(void) {
    static float position[N][3], normal[N][3], irradiance[N][3];
    static uint8_t status[N];
    uint64_t rays = 0;
    lumi_device device;
    lumi_scene scene;
    lumi_cache cache;
    lumi_host_desc host = {0};
    lumi_query query = {0};
    double sum = 0;
    int i, k, missing = 0;

    for (i = 0; i < N; i++) { /* a spiral over the shell */
        float z = 1 - 2 * (i + 0.5f) / N, r = sqrtf(1 - z * z), phi = 2.3999632f * i;
        position[i][0] = r * cosf(phi), position[i][1] = r * sinf(phi), position[i][2] = z;
        for (k = 0; k < 3; k++) normal[i][k] = -position[i][k];
    }
    check(lumi_device_new(LUMI_ABI_VERSION, NULL, &device));
    check(lumi_scene_new(device, &scene));
    host.struct_size = sizeof host;
    for (k = 0; k < 3; k++) host.bounds_min[k] = -1, host.bounds_max[k] = 1;
    host.scene_hash = 1;
    host.trace = trace, host.user = &rays;
    check(lumi_scene_set_host(scene, &host));
    check(lumi_scene_commit(scene));
    check(lumi_cache_new(scene, NULL, &cache));
    check(lumi_cache_set_i32(cache, "gather.rays", 128));
    check(lumi_cache_set_i32(cache, "deeper_points", 1000));

    query.struct_size = sizeof query;
    query.n = N;
    query.position = position[0], query.normal = normal[0];
    check(lumi_cache_build(cache, &query));
    query.irradiance = irradiance[0], query.status = status;
    check(lumi_cache_query(cache, &query));
    for (i = 0; i < N; i++) {
        sum += irradiance[i][1] / N;
        missing += status[i] != LUMI_POINT_INTERPOLATED;
    }
    printf("irradiance %.4f, %d of %d points missing, %llu rays\n", sum, missing, N,
           (unsigned long long)rays);
    lumi_cache_release(cache);
    lumi_scene_release(scene);
    lumi_device_release(device);
    return missing == 0 && fabs(sum / 3.14159265 - 1) < 0.03 ? 0 : 1;
}
