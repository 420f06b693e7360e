/* host.c - a scene that the library keeps: a box of five walls lit by a lamp. Prints the indirect
   irradiance at points of the floor.

   cc -std=c99 host.c $(pkg-config --cflags --libs lumicache) -o host && ./host [threads] */
#include <lumicache.h>
#include <stdio.h>
#include <stdlib.h>

#define POINTS 64 /* on each side of the floor */

static void check(lumi_error code) {
    const char *message;
    if (code == LUMI_OK) return;
    lumi_get_last_error(&message);
    fprintf(stderr, "error %d: %s\n", (int)code, message);
    exit(1);
}

static uint32_t material(lumi_scene scene, float r, float g, float b, float emission) {
    lumi_material_desc m;
    uint32_t id;
    check(lumi_material_init(&m));
    m.base_color[0] = r, m.base_color[1] = g, m.base_color[2] = b;
    m.specular = 0; /* purely diffuse */
    m.emission[0] = m.emission[1] = m.emission[2] = emission;
    check(lumi_scene_add_material(scene, &m, &id));
    return id;
}

/* A parallelogram with the corner `o` and the sides `a` and `b`; a x b points to its front. */
static void quad(lumi_scene scene, const float o[3], const float a[3], const float b[3],
                 uint32_t material) {
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    float p[12];
    lumi_mesh_desc mesh = {0};
    uint32_t id;
    int k;
    for (k = 0; k < 3; k++) {
        p[k] = o[k], p[3 + k] = o[k] + a[k];
        p[6 + k] = o[k] + a[k] + b[k], p[9 + k] = o[k] + b[k];
    }
    mesh.struct_size = sizeof mesh;
    mesh.positions.data = p, mesh.positions.count = 4, mesh.positions.format = LUMI_FORMAT_F32X3;
    mesh.indices.data = indices, mesh.indices.count = 2, mesh.indices.format = LUMI_FORMAT_U32X3;
    mesh.material = material;
    check(lumi_scene_add_mesh(scene, &mesh, &id));
    check(lumi_scene_add_instance(scene, id, NULL));
}

int main(int argc, char **argv) {
    static const float o[3] = {0, 0, 0}, x[3] = {1, 0, 0}, y[3] = {0, 1, 0}, z[3] = {0, 0, 1};
    static const float right[3] = {1, 0, 0}, top[3] = {0, 1, 0}, lamp[3] = {0.35f, 0.99f, 0.35f};
    static const float lx[3] = {0.3f, 0, 0}, lz[3] = {0, 0, 0.3f};
    static float position[POINTS * POINTS][3], normal[POINTS * POINTS][3];
    static float irradiance[POINTS * POINTS][3];
    static uint8_t status[POINTS * POINTS];
    char config[32], backend[64];
    lumi_device device;
    lumi_scene scene;
    lumi_cache cache;
    lumi_query query = {0};
    lumi_stats stats = {0};
    uint32_t white, red, green;
    int i;

    sprintf(config, "threads=%d", argc > 1 ? atoi(argv[1]) : 0);
    check(lumi_device_new(LUMI_ABI_VERSION, config, &device));
    check(lumi_device_get_backend(device, backend, sizeof backend));
    check(lumi_scene_new(device, &scene));
    white = material(scene, 0.7f, 0.7f, 0.7f, 0);
    red = material(scene, 0.6f, 0.1f, 0.1f, 0), green = material(scene, 0.1f, 0.5f, 0.1f, 0);
    quad(scene, o, z, x, white);      /* floor */
    quad(scene, top, x, z, white);    /* ceiling */
    quad(scene, o, x, y, white);      /* back */
    quad(scene, o, y, z, red);        /* left */
    quad(scene, right, z, y, green);  /* right */
    quad(scene, lamp, lx, lz, material(scene, 0, 0, 0, 15));
    check(lumi_scene_commit(scene));

    for (i = 0; i < POINTS * POINTS; i++) {
        position[i][0] = (i % POINTS + 0.5f) / POINTS;
        position[i][2] = (i / POINTS + 0.5f) / POINTS;
        normal[i][1] = 1;
    }
    check(lumi_cache_new(scene, "auto", &cache));
    check(lumi_cache_set_i32(cache, "gather.rays", 256));
    query.struct_size = sizeof query;
    query.n = POINTS * POINTS;
    query.position = position[0], query.normal = normal[0];
    check(lumi_cache_build(cache, &query));
    query.irradiance = irradiance[0], query.status = status;
    check(lumi_cache_query(cache, &query));

    for (i = 0; i < POINTS * POINTS; i++)
        printf("%d %a %a %a\n", status[i], irradiance[i][0], irradiance[i][1], irradiance[i][2]);
    stats.struct_size = sizeof stats;
    check(lumi_cache_get_stats(cache, &stats));
    fprintf(stderr, "%s: %llu records\n", backend, (unsigned long long)stats.records);
    lumi_cache_release(cache);
    lumi_scene_release(scene);
    lumi_device_release(device);
    return 0;
}
