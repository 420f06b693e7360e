// An integrator for Mitsuba 3 (variant scalar_rgb). Mitsuba traces and shades what the camera sees
// and its direct light; Lumicache answers with the indirect light of diffuse surfaces.
//
// The library gets shapes, the diffuse reflectance of their BSDFs, area lights and the environment
// once. Records are made at the points that the camera sees. README.md has the parameters and the
// limits.

#include <lumicache.h>

#include <mitsuba/core/properties.h>
#include <mitsuba/render/bsdf.h>
#include <mitsuba/render/emitter.h>
#include <mitsuba/render/film.h>
#include <mitsuba/render/integrator.h>
#include <mitsuba/render/mesh.h>
#include <mitsuba/render/records.h>
#include <mitsuba/render/scene.h>
#include <mitsuba/render/sensor.h>
#include <mitsuba/render/shape.h>

NAMESPACE_BEGIN(mitsuba)

template <typename Float, typename Spectrum>
class LumicacheIntegrator final : public SamplingIntegrator<Float, Spectrum> {
public:
    MI_IMPORT_BASE(SamplingIntegrator)
    MI_IMPORT_TYPES(Scene, Sensor, Sampler, Medium, Emitter, Shape, Mesh, BSDF, BSDFPtr, EmitterPtr)

    // What the library needs is plain single precision.
    static constexpr bool Supported = std::is_same_v<Float, float> && is_rgb_v<Spectrum>;

    LumicacheIntegrator(const Properties &props) : Base(props) {
        if constexpr (!Supported)
            Throw("lumicache: this plugin is for the variant scalar_rgb");
        m_preset = props.get<std::string>("preset", "auto");
        m_quality = props.get<ScalarFloat>("quality", 1.f);
        m_direct_samples = (uint32_t) props.get<int>("direct_samples", 1);
        m_cache_file = props.get<std::string>("cache_file", "");
        if (lumi_get_abi_version() >> 16 != LUMI_ABI_VERSION >> 16)
            Throw("lumicache: the library %s has another ABI than the plugin",
                  lumi_get_version_string());
        check(lumi_device_new(LUMI_ABI_VERSION, nullptr, &m_device));
        char backend[64];
        check(lumi_device_get_backend(m_device, backend, sizeof backend));
        Log(Info, "lumicache %s, %s", lumi_get_version_string(), backend);
    }

    ~LumicacheIntegrator() {
        lumi_cache_release(m_cache);
        lumi_device_release(m_device);
    }

    TensorXf render(Scene *scene, Sensor *sensor, UInt32 seed, uint32_t spp, bool develop,
                    bool evaluate) override {
        if constexpr (Supported)
            prepare(scene, sensor);
        return Base::render(scene, sensor, seed, spp, develop, evaluate);
    }

    std::pair<Spectrum, Mask> sample(const Scene *scene, Sampler *sampler,
                                     const RayDifferential3f &ray, const Medium *, Float *,
                                     Mask active) const override {
        if constexpr (Supported) {
            SurfaceInteraction3f si = scene->ray_intersect(ray, active);
            Spectrum result(0.f);
            if (EmitterPtr emitter = si.emitter(scene); emitter)
                result += emitter->eval(si);
            if (!si.is_valid())
                return { result, false };

            BSDFPtr bsdf = si.bsdf(ray);
            BSDFContext context;
            for (uint32_t i = 0; i < m_direct_samples; i++) {
                auto [ds, weight] = scene->sample_emitter_direction(si, sampler->next_2d(), true);
                if (ds.pdf > 0.f)
                    result += bsdf->eval(context, si, si.to_local(ds.d)) * weight /
                              (float) m_direct_samples;
            }
            result += bsdf->eval_diffuse_reflectance(si) * indirect(si, ray.d) * dr::InvPi<float>;
            return { result, true };
        }
        return { Spectrum(0.f), false };
    }

    MI_DECLARE_CLASS(LumicacheIntegrator)

private:
    static void check(lumi_error code) {
        if (code == LUMI_OK)
            return;
        const char *message = nullptr;
        lumi_get_last_error(&message);
        Throw("%s", message);
    }

    /// The surface normal on the side of the viewer.
    static auto facing(const SurfaceInteraction3f &si, const Vector3f &d) {
        auto n = si.sh_frame.n;
        return dr::dot(n, d) > 0.f ? -n : n;
    }

    Spectrum indirect(const SurfaceInteraction3f &si, const Vector3f &d) const {
        auto n = facing(si, d);
        float position[3] = { si.p.x(), si.p.y(), si.p.z() };
        float normal[3] = { n.x(), n.y(), n.z() }, irradiance[3];
        lumi_query query{};
        query.struct_size = sizeof query;
        // A point that was not among the seeds gets a record of its own.
        query.flags = LUMI_QUERY_FILL;
        query.n = 1;
        query.position = position, query.normal = normal, query.irradiance = irradiance;
        query.footprint = &m_footprint;
        check(lumi_cache_query(m_cache, &query));
        return Spectrum(irradiance[0], irradiance[1], irradiance[2]);
    }

    void prepare(Scene *scene, Sensor *sensor) {
        if (m_cache && m_prepared == scene)
            return;
        lumi_cache_release(std::exchange(m_cache, nullptr));
        lumi_scene world;
        check(lumi_scene_new(m_device, &world));
        try {
            for (auto &shape : scene->shapes())
                add_shape(world, shape.get());
            for (auto &emitter : scene->emitters())
                if (!has_flag(emitter->flags(), EmitterFlags::Surface) &&
                    !has_flag(emitter->flags(), EmitterFlags::Infinite))
                    Throw("lumicache: area emitters and environments are supported, not %s",
                          emitter->to_string());
            if (scene->environment())
                add_environment(world, scene->environment());
            check(lumi_scene_commit(world));
            check(lumi_cache_new(world, m_preset.c_str(), &m_cache));
        } catch (...) {
            lumi_scene_release(world);
            throw;
        }
        lumi_scene_release(world);
        check(lumi_cache_set_f32(m_cache, "quality", (float) m_quality));
        if (!m_cache_file.empty() && lumi_cache_load(m_cache, m_cache_file.c_str(), 0) != LUMI_OK) {
            const char *message = nullptr;
            lumi_get_last_error(&message);
            Log(Warn, "%s", message);
        }
        seed(scene, sensor);
        if (!m_cache_file.empty())
            check(lumi_cache_save(m_cache, m_cache_file.c_str()));
        m_prepared = scene;
    }

    /// Makes records at the points that the camera sees, one for each pixel.
    void seed(Scene *scene, Sensor *sensor) {
        auto size = sensor->film()->crop_size();
        std::vector<float> position, normal, footprint;
        for (uint32_t y = 0; y < size.y(); y++)
            for (uint32_t x = 0; x < size.x(); x++) {
                Point2f at((x + .5f) / size.x(), (y + .5f) / size.y());
                auto [ray, weight] = sensor->sample_ray_differential(0.f, .5f, at, Point2f(.5f));
                SurfaceInteraction3f si = scene->ray_intersect(ray);
                if (!si.is_valid())
                    continue;
                auto n = facing(si, ray.d);
                position.insert(position.end(), { si.p.x(), si.p.y(), si.p.z() });
                normal.insert(normal.end(), { n.x(), n.y(), n.z() });
                float cosine = std::max(std::abs(dr::dot(n, ray.d)), .1f);
                footprint.push_back(si.t * dr::norm(ray.d_x - ray.d) / std::sqrt(cosine));
            }
        if (footprint.empty())
            return;
        lumi_query query{};
        query.struct_size = sizeof query;
        query.n = footprint.size();
        query.position = position.data(), query.normal = normal.data();
        query.footprint = footprint.data();
        check(lumi_cache_build(m_cache, &query));
        lumi_stats stats{};
        stats.struct_size = sizeof stats;
        check(lumi_cache_get_stats(m_cache, &stats));
        Log(Info, "lumicache: %u records, %.2f s", (uint32_t) stats.records, stats.build_seconds);
        float sum = 0.f;
        for (float f : footprint)
            sum += f;
        m_footprint = sum / footprint.size();
    }

    /// Vertices and triangles of a mesh, or a grid over the parameters of another shape.
    static void triangulate(Shape *shape, std::vector<float> &vertices,
                            std::vector<uint32_t> &indices) {
        if (shape->is_mesh()) {
            auto *mesh = static_cast<Mesh *>(shape);
            const float *v = mesh->vertex_positions_buffer().data();
            const uint32_t *f = mesh->faces_buffer().data();
            vertices.assign(v, v + 3 * mesh->vertex_count());
            indices.assign(f, f + 3 * mesh->face_count());
            return;
        }
        const uint32_t n = 48;
        for (uint32_t j = 0; j <= n; j++)
            for (uint32_t i = 0; i <= n; i++) {
                Point2f uv((float) i / n, (float) j / n);
                SurfaceInteraction3f si = shape->eval_parameterization(uv);
                vertices.insert(vertices.end(), { si.p.x(), si.p.y(), si.p.z() });
                uint32_t a = j * (n + 1) + i;
                if (i < n && j < n)
                    indices.insert(indices.end(), { a, a + 1, a + n + 2, a, a + n + 2, a + n + 1 });
            }
    }

    void add_shape(lumi_scene world, Shape *shape) {
        std::vector<float> vertices;
        std::vector<uint32_t> indices;
        triangulate(shape, vertices, indices);

        SurfaceInteraction3f si = dr::zeros<SurfaceInteraction3f>();
        si.uv = Point2f(.5f);
        si.wi = Vector3f(0.f, 0.f, 1.f);
        si.n = Normal3f(0.f, 0.f, 1.f);
        si.sh_frame = Frame3f(si.n);
        si.shape = shape;
        lumi_material_desc material;
        check(lumi_material_init(&material));
        Spectrum albedo(0.f);
        if (shape->bsdf())
            albedo = shape->bsdf()->eval_diffuse_reflectance(si);
        Spectrum emission = shape->is_emitter() ? shape->emitter()->eval(si) : Spectrum(0.f);
        for (size_t k = 0; k < 3; k++) {
            material.base_color[k] = std::clamp((float) albedo[k], 0.f, 1.f);
            material.emission[k] = (float) emission[k];
        }
        material.specular = 0.f;
        uint32_t id;
        check(lumi_scene_add_material(world, &material, &id));

        lumi_mesh_desc mesh{};
        mesh.struct_size = sizeof mesh;
        mesh.positions = { vertices.data(), vertices.size() / 3, 0, LUMI_FORMAT_F32X3, 0 };
        mesh.indices = { indices.data(), indices.size() / 3, 0, LUMI_FORMAT_U32X3, 0 };
        mesh.material = id;
        check(lumi_scene_add_mesh(world, &mesh, &id));
        check(lumi_scene_add_instance(world, id, nullptr));
    }

    void add_environment(lumi_scene world, const Emitter *environment) {
        const uint32_t width = 512, height = 256;
        std::vector<float> pixels;
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                float theta = (y + .5f) / height * dr::Pi<float>;
                float phi = ((x + .5f) / width - .5f) * dr::TwoPi<float>;
                SurfaceInteraction3f si = dr::zeros<SurfaceInteraction3f>();
                si.wi = -Vector3f(std::sin(theta) * std::cos(phi), std::cos(theta),
                                  std::sin(theta) * std::sin(phi));
                Spectrum radiance = environment->eval(si);
                for (size_t k = 0; k < 3; k++)
                    pixels.push_back((float) radiance[k]);
            }
        check(lumi_scene_set_environment(world, pixels.data(), width, height, nullptr));
    }

    std::string m_preset, m_cache_file;
    ScalarFloat m_quality;
    uint32_t m_direct_samples;
    float m_footprint = 0.f;
    lumi_device m_device = nullptr;
    lumi_cache m_cache = nullptr;
    const Scene *m_prepared = nullptr;
};

MI_EXPORT_PLUGIN(LumicacheIntegrator)
NAMESPACE_END(mitsuba)
