//! What the host describes, as scene data.

use super::abi::{
    Input, LUMI_ALPHA_BLEND, LUMI_ALPHA_MASK, LUMI_ALPHA_OPAQUE, LUMI_FORMAT_F32X2,
    LUMI_FORMAT_F32X3, LUMI_FORMAT_F32X4, LUMI_FORMAT_U32, LUMI_FORMAT_U32X3,
    LUMI_LIGHT_DIRECTIONAL, LUMI_LIGHT_POINT, LUMI_LIGHT_SPOT, LUMI_MATERIAL_DOUBLE_SIDED,
    LUMI_WRAP_CLAMP, LUMI_WRAP_MIRROR, LUMI_WRAP_REPEAT, lent, lumi_light_desc, lumi_material_desc,
    lumi_mesh_desc, lumi_texture_desc, lumi_view, only,
};
use super::status::{Fault, Outcome, ensure};
use crate::geometry::TriangleMesh;
use crate::light::{EnvironmentMap, PunctualLight};
use crate::material::{AlphaMode, Material};
use crate::math::{Affine3A, Color, Mat3, Vec2, Vec3, Vec4};
use crate::texture::{ColorSpace, Texture, TextureImage, TexturePixels, TextureRef, Wrap};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Largest size of a texture along an axis.
const MAX_TEXTURE: u32 = 1 << 16;

fn none(what: &str, number: u32) -> Fault {
    Fault::argument(format!("{what} {number}"))
}

fn finite(v: Vec3, what: &str) -> Outcome<Vec3> {
    ensure!(v.is_finite(), "{what} {v} is no finite vector");
    Ok(v)
}

fn unit(v: Vec3, what: &str) -> Outcome<Vec3> {
    finite(v, what)?.try_normalize().ok_or_else(|| Fault::argument(format!("{what} is zero")))
}

/// `value`, which must lie between `low` and `high`.
pub(super) fn in_range(value: f32, low: f32, high: f32, what: &str) -> Outcome<f32> {
    let inside = (low..=high).contains(&value);
    ensure!(inside, "{what} is {value}, expected {low} to {high}");
    Ok(value)
}

fn not_negative(c: [f32; 3], what: &str) -> Outcome<Color> {
    let c = finite(c.into(), what)?;
    ensure!(c.min_element() >= 0.0, "{what} {c} is negative");
    Ok(c)
}

/// The transform of 12 floats, columns x, y, z and translation.
pub(super) fn transform(floats: &[f32; 12], what: &str) -> Outcome<Affine3A> {
    let m = Affine3A::from_cols_array(floats);
    let determinant = m.matrix3.determinant();
    let sound = m.is_finite() && determinant.is_finite() && determinant != 0.0;
    ensure!(sound, "{what} is singular or not finite");
    Ok(m)
}

/// The arrays of `desc`.
pub(super) fn views(desc: &lumi_mesh_desc) -> [lumi_view; 6] {
    let (positions, triangles) = (desc.positions, desc.triangle_materials);
    [positions, desc.indices, desc.normals, desc.uv0, desc.colors, triangles]
}

/// The meshes of `desc`, one for each material it uses; materials are below `materials`. Positions
/// and indices that the host shares stay where they are if they are dense and of one material.
pub(super) fn meshes(desc: &lumi_mesh_desc, materials: usize) -> Outcome<Vec<TriangleMesh>> {
    let missing = |what: &str| Fault::argument(format!("mesh: there are no {what}"));
    let positions =
        Input::<f32, 3>::of_view(&desc.positions, LUMI_FORMAT_F32X3, "mesh: positions")?;
    let indices = Input::<u32, 3>::of_view(&desc.indices, LUMI_FORMAT_U32X3, "mesh: indices")?;
    let positions = positions.ok_or_else(|| missing("positions"))?;
    let indices = indices.ok_or_else(|| missing("indices"))?;
    let normals = Input::<f32, 3>::of_view(&desc.normals, LUMI_FORMAT_F32X3, "mesh: normals")?;
    let uv = Input::<f32, 2>::of_view(&desc.uv0, LUMI_FORMAT_F32X2, "mesh: uv0")?;
    let colors = Input::<f32, 4>::of_view(&desc.colors, LUMI_FORMAT_F32X4, "mesh: colors")?;
    let own = &desc.triangle_materials;
    let own = Input::<u32, 1>::of_view(own, LUMI_FORMAT_U32, "mesh: triangle_materials")?;
    let vertices = positions.len();
    for (what, count, wanted, things) in [
        ("normals", normals.map(|v| v.len()), vertices, "vertices"),
        ("uv0", uv.map(|v| v.len()), vertices, "vertices"),
        ("colors", colors.map(|v| v.len()), vertices, "vertices"),
        ("triangle_materials", own.map(|v| v.len()), indices.len(), "triangles"),
    ] {
        let n = count.unwrap_or(wanted);
        ensure!(n == wanted, "mesh: {what} has {n} elements for {wanted} {things}");
    }
    let positions: Vec<Vec3> = positions.iter().map(Vec3::from).collect();
    for (i, p) in positions.iter().enumerate() {
        ensure!(p.is_finite(), "mesh: position {i} is no finite vector");
    }
    // The surface replaces a normal that is zero.
    let normals: Option<Vec<Vec3>> = normals
        .map(|n| n.iter().map(|n| finite_or_zero(Vec3::from(n)).normalize_or_zero()).collect());
    let uv: Option<Vec<Vec2>> =
        uv.map(|t| t.iter().map(|t| Vec2::from(t.map(number_or_zero))).collect());
    let colors: Option<Vec<Vec4>> = colors.map(|c| {
        c.iter().map(|c| Vec4::from(c.map(number_or_zero)).clamp(Vec4::ZERO, Vec4::ONE)).collect()
    });

    let mut by_material: BTreeMap<u32, Vec<[u32; 3]>> = BTreeMap::new();
    for (i, triangle) in indices.iter().enumerate() {
        let inside = triangle.iter().all(|v| (*v as usize) < vertices);
        ensure!(inside, "mesh: triangle {i} has a vertex beyond its {vertices}");
        let material = own.map_or(desc.material, |m| m.get(i)[0]);
        ensure!(
            (material as usize) < materials,
            "mesh: triangle {i} has material {material}, of which there are {materials}"
        );
        by_material.entry(material).or_default().push(triangle);
    }
    let whole = TriangleMesh {
        positions: positions.into(),
        normals,
        uv: [uv, None],
        colors,
        ..TriangleMesh::default()
    };
    if by_material.len() > 1 {
        return Ok(by_material
            .into_iter()
            .map(|(material, triangles)| part(&whole, triangles, material))
            .collect());
    }
    let one = |(material, triangles): (u32, Vec<[u32; 3]>)| TriangleMesh {
        positions: lent(&desc.positions).unwrap_or(whole.positions),
        indices: lent(&desc.indices).unwrap_or_else(|| triangles.into()),
        material,
        ..whole
    };
    Ok(by_material.pop_first().map(one).into_iter().collect())
}

fn number_or_zero(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

fn finite_or_zero(v: Vec3) -> Vec3 {
    if v.is_finite() { v } else { Vec3::ZERO }
}

/// The mesh of some triangles of `whole`, with the vertices that they use.
fn part(whole: &TriangleMesh, mut triangles: Vec<[u32; 3]>, material: u32) -> TriangleMesh {
    let mut number = vec![u32::MAX; whole.positions.len()];
    let mut used = Vec::new();
    for v in triangles.as_flattened_mut() {
        let new = &mut number[*v as usize];
        if *new == u32::MAX {
            *new = used.len() as u32;
            used.push(*v as usize);
        }
        *v = *new;
    }
    fn pick<T: Copy>(values: &[T], used: &[usize]) -> Vec<T> {
        used.iter().map(|i| values[*i]).collect()
    }
    TriangleMesh {
        positions: pick(&whole.positions, &used).into(),
        normals: whole.normals.as_ref().map(|n| pick(n, &used)),
        uv: [whole.uv[0].as_ref().map(|t| pick(t, &used)), None],
        colors: whole.colors.as_ref().map(|c| pick(c, &used)),
        indices: triangles.into(),
        material,
        ..TriangleMesh::default()
    }
}

/// glTF's default material but for a metallic factor of 0, as most hosts have it.
pub(super) fn default_material() -> lumi_material_desc {
    lumi_material_desc {
        struct_size: size_of::<lumi_material_desc>() as u32,
        flags: 0,
        base_color: [0.8; 3],
        alpha: 1.0,
        alpha_mode: LUMI_ALPHA_OPAQUE,
        alpha_cutoff: 0.5,
        metallic: 0.0,
        roughness: 0.5,
        ior: 1.5,
        specular: 1.0,
        transmission: 0.0,
        emission: [0.0; 3],
        base_color_texture: -1,
        metallic_roughness_texture: -1,
        emission_texture: -1,
        normal_texture: -1,
    }
}

/// The material of `desc`; textures are below `textures`.
pub(super) fn material(desc: &lumi_material_desc, textures: usize) -> Outcome<Material> {
    let texture = |id: i32, color_space: ColorSpace, what: &str| match usize::try_from(id) {
        Err(_) => Ok(None),
        Ok(n) if n < textures => Ok(Some(TextureRef {
            texture: n as u32,
            uv_set: 0,
            offset: Vec2::ZERO,
            rotation: 0.0,
            scale: Vec2::ONE,
            color_space,
        })),
        Ok(n) => Err(Fault::argument(format!("material: {what} is {n}, of {textures} textures"))),
    };
    let share = |value: f32, what: &str| in_range(value, 0.0, 1.0, &format!("material: {what}"));
    let base_color = not_negative(desc.base_color, "material: base_color")?;
    share(base_color.max_element(), "base_color")?;
    only(LUMI_MATERIAL_DOUBLE_SIDED, desc.flags, "material")?;
    let (color, glossy) = (desc.base_color_texture, desc.metallic_roughness_texture);
    Ok(Material {
        base_color,
        base_alpha: share(desc.alpha, "alpha")?,
        base_color_texture: texture(color, ColorSpace::Srgb, "base_color_texture")?,
        metallic: share(desc.metallic, "metallic")?,
        roughness: share(desc.roughness, "roughness")?,
        metallic_roughness_texture: texture(
            glossy,
            ColorSpace::Linear,
            "metallic_roughness_texture",
        )?,
        normal_texture: texture(desc.normal_texture, ColorSpace::Linear, "normal_texture")?,
        emission: not_negative(desc.emission, "material: emission")?,
        emission_texture: texture(desc.emission_texture, ColorSpace::Srgb, "emission_texture")?,
        alpha_mode: match desc.alpha_mode {
            LUMI_ALPHA_OPAQUE => AlphaMode::Opaque,
            LUMI_ALPHA_MASK => AlphaMode::Mask(share(desc.alpha_cutoff, "alpha_cutoff")?),
            LUMI_ALPHA_BLEND => AlphaMode::Blend,
            other => return Err(none("material: there is no alpha_mode", other)),
        },
        double_sided: desc.flags & LUMI_MATERIAL_DOUBLE_SIDED != 0,
        ior: in_range(desc.ior, 1.0, 100.0, "material: ior")?,
        specular: share(desc.specular, "specular")?,
        transmission: share(desc.transmission, "transmission")?,
        ..Material::default()
    })
}

/// The texture of `desc`.
pub(super) fn texture(desc: &lumi_texture_desc) -> Outcome<Texture> {
    let (width, height) = (desc.width, desc.height);
    ensure!(
        [width, height].iter().all(|n| (1..=MAX_TEXTURE).contains(n)),
        "texture: {width} x {height} pixels; up to {MAX_TEXTURE} x {MAX_TEXTURE} are possible"
    );
    let wrap = |mode: u32| match mode {
        LUMI_WRAP_REPEAT => Ok(Wrap::Repeat),
        LUMI_WRAP_MIRROR => Ok(Wrap::Mirror),
        LUMI_WRAP_CLAMP => Ok(Wrap::Clamp),
        other => Err(none("texture: there is no wrapping", other)),
    };
    let (wrap_s, wrap_t) = (wrap(desc.wrap_u)?, wrap(desc.wrap_v)?);
    let count = width as usize * height as usize;
    let pixels = Input::<u8, 4>::required(desc.pixels, count, 0, "texture: pixels")?;
    let pixels = TexturePixels::Rgba8(pixels.iter().collect());
    let image = Arc::new(TextureImage { width, height, pixels });
    Ok(Texture { image, wrap_s, wrap_t, nearest: desc.nearest != 0 })
}

/// The light of `desc`.
pub(super) fn light(desc: &lumi_light_desc) -> Outcome<PunctualLight> {
    let intensity = not_negative(desc.intensity, "light: intensity")?;
    let range = if desc.range == 0.0 {
        f32::INFINITY
    } else {
        in_range(desc.range, 0.0, f32::INFINITY, "light: range")?
    };
    let position = || finite(desc.position.into(), "light: position");
    let direction = || unit(desc.direction.into(), "light: direction");
    Ok(match desc.kind {
        LUMI_LIGHT_POINT => PunctualLight::Point { position: position()?, intensity, range },
        LUMI_LIGHT_SPOT => {
            let cos_outer = in_range(desc.cos_outer, -1.0, 1.0, "light: cos_outer")?;
            let cos_inner = in_range(desc.cos_inner, cos_outer, 1.0, "light: cos_inner")?;
            PunctualLight::Spot {
                position: position()?,
                direction: direction()?,
                intensity,
                range,
                inner: 1.0 - cos_inner,
                outer: 1.0 - cos_outer,
            }
        }
        LUMI_LIGHT_DIRECTIONAL => {
            PunctualLight::Directional { direction: direction()?, irradiance: intensity }
        }
        other => return Err(none("light: there is no kind", other)),
    })
}

/// The environment of `width` times `height` pixels at `rgb`, `None` for NULL. `to_map` is the
/// rotation from the world, if not NULL.
pub(super) fn environment(
    rgb: *const f32, width: u32, height: u32, to_map: *const f32,
) -> Outcome<Option<EnvironmentMap>> {
    if rgb.is_null() {
        return Ok(None);
    }
    let count = width as usize * height as usize;
    let possible = (1..=1 << 28).contains(&count);
    ensure!(possible, "an environment of {width} x {height} pixels is not possible");
    let pixels = Input::<f32, 3>::required(rgb, count, 0, "rgb")?;
    let rotation = match Input::<f32, 9>::new(to_map, 1, 0, "to_map")? {
        Some(floats) => Mat3::from_cols_array(&floats.get(0)),
        None => Mat3::IDENTITY,
    };
    let error = rotation * rotation.transpose() - Mat3::IDENTITY;
    let error = error.to_cols_array().iter().fold(0.0_f32, |a, x| a.max(x.abs()));
    ensure!(rotation.is_finite() && error <= 1e-3, "to_map is no rotation");
    let pixels = pixels.iter().map(Color::from).collect();
    let from_world = Affine3A::from_mat3(rotation);
    Ok(Some(EnvironmentMap { width, height, pixels, scale: 1.0, from_world }))
}

#[cfg(test)]
mod tests {
    use super::super::abi::LUMI_VIEW_SHARED;
    use super::*;

    #[test]
    fn shared_arrays_stay_where_they_are_if_they_are_as_ours() {
        let corners = [[0.0_f32; 4], [1.0, 0.0, 0.0, 9.0], [0.0, 1.0, 0.0, 9.0]];
        let dense = corners.map(|c| [c[0], c[1], c[2]]);
        let triangles = [[0_u32, 1, 2], [2, 1, 0]];
        let view = |data: *const f32, stride, flags| lumi_view {
            data: data.cast(),
            count: 3,
            stride,
            format: LUMI_FORMAT_F32X3,
            flags,
        };
        let of = |positions: lumi_view, flags: u32, materials: Option<&[u32; 2]>| {
            let none =
                lumi_view { data: std::ptr::null(), count: 0, stride: 0, format: 0, flags: 0 };
            let indices = lumi_view {
                data: triangles.as_ptr().cast(),
                count: 2,
                stride: 0,
                format: LUMI_FORMAT_U32X3,
                flags,
            };
            let triangle_materials = materials.map_or(none, |m| lumi_view {
                data: m.as_ptr().cast(),
                count: 2,
                stride: 0,
                format: LUMI_FORMAT_U32,
                flags: 0,
            });
            let desc = lumi_mesh_desc {
                struct_size: 0,
                flags: 0,
                positions,
                indices,
                normals: none,
                uv0: none,
                colors: none,
                triangle_materials,
                material: 0,
                reserved: 0,
            };
            meshes(&desc, 2).ok().unwrap()
        };
        let lent = |m: &TriangleMesh| (m.positions.is_lent(), m.indices.is_lent());
        let shared = of(view(dense.as_ptr().cast(), 12, LUMI_VIEW_SHARED), LUMI_VIEW_SHARED, None);
        assert_eq!(
            (lent(&shared[0]), shared[0].positions.as_ptr().cast()),
            ((true, true), dense.as_ptr())
        );
        assert_eq!((shared[0].positions[1], shared[0].indices[1]), (Vec3::X, [2, 1, 0]));
        // Not asked for; not dense; of two materials.
        assert_eq!(
            lent(&of(view(dense.as_ptr().cast(), 12, 0), LUMI_VIEW_SHARED, None)[0]),
            (false, true)
        );
        assert_eq!(
            lent(&of(view(corners.as_ptr().cast(), 16, LUMI_VIEW_SHARED), 0, None)[0]),
            (false, false)
        );
        let split =
            of(view(dense.as_ptr().cast(), 12, LUMI_VIEW_SHARED), LUMI_VIEW_SHARED, Some(&[0, 1]));
        assert!(split.len() == 2 && split.iter().all(|m| lent(m) == (false, false)));
    }
}
