//! What shines: emissive triangles with their mean radiance and where on them the light is.

use crate::geometry::{Geometry, TriangleMesh, interpolate};
use crate::light::{Emitter, Pattern};
use crate::material::{AlphaMode, Material};
use crate::math::{Color, DVec2, Vec2, Vec3};
use crate::sampling::{lattice_point, square_to_triangle};
use crate::texture::{ColorSpace, SummedTable, Texture, TextureRef, Wrap, area, integrals};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Most cells of a table; cells of larger textures are blocks of texels.
const CELLS: f64 = (1 << 20) as f64;
/// Farther out in the plane of a texture, in cells, single precision knows no cells.
const FAR: f64 = 1e9;
/// A triangle that extends over no more cells, or is thinner than `THIN` cells, is judged by
/// points.
const FEW: f64 = 4.0;
/// See `FEW`.
const THIN: f64 = 1e-2;
/// Least contrast of a pattern that is worth sampling by: 1 for even emission, and the more the
/// less of a triangle glows.
const CONTRAST: f64 = 1.2;
/// Points at which the alpha of a pattern is asked for.
const ASKED: u32 = 64;

/// What emission and opacity a table holds; equal ones share it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    texture: u32,
    linear: bool,
    /// Opacity by the same coordinates: texture, alpha factor, and cutoff of a mask.
    alpha: Option<(u32, bool, u32, Option<u32>)>,
}

/// Emission and opacity of textures in cells, without the emission factor.
struct Table {
    size: [f64; 2],
    /// Mean over the channels, red, green, blue, and the square of the mean.
    sums: SummedTable<5>,
    /// Mean over the channels; `None` where all cells are alike.
    shared: Option<Arc<SummedTable<1>>>,
}

/// The emission of the triangles of a mesh: mean radiance and pattern.
type Glows = Vec<(Color, Option<Pattern>)>;

/// The materials and textures of a scene.
#[derive(Clone, Copy)]
struct Surfaces<'a> {
    geometry: &'a Geometry,
    materials: &'a [Material],
    textures: &'a [Texture],
}

/// The emissive triangles with their mean radiance, and how it is spread over them, by instance and
/// triangle. Tables are made one after another, and only what patterns need is kept.
pub(super) fn emitters(
    geometry: &Geometry, materials: &[Material], textures: &[Texture],
) -> (Vec<Emitter>, Vec<(u32, u32, Pattern)>) {
    let surfaces = Surfaces { geometry, materials, textures };
    let mut by_table: BTreeMap<Option<Key>, BTreeMap<u32, u32>> = BTreeMap::new();
    for (i, instance) in (0..).zip(&geometry.instances) {
        let material = surfaces.material_of(instance.mesh);
        if material.is_emissive() {
            let key = surfaces.key(material);
            by_table.entry(key).or_default().entry(instance.mesh).or_insert(i);
        }
    }
    let mut glows: HashMap<u32, Glows> = HashMap::new();
    for (key, meshes) in by_table {
        let table = key.map(|key| {
            let first = meshes.keys().next().map_or(0, |mesh| *mesh);
            surfaces.table(surfaces.material_of(first), key)
        });
        for (mesh, instance) in meshes {
            glows.insert(mesh, surfaces.glows(instance, table.as_ref()));
        }
    }
    let (mut list, mut patterns) = (Vec::new(), Vec::new());
    for (i, instance) in (0..).zip(&geometry.instances) {
        let Some(glows) = glows.get(&instance.mesh) else { continue };
        let double_sided = surfaces.material_of(instance.mesh).double_sided;
        for (triangle, (radiance, pattern)) in (0..).zip(glows) {
            if radiance.max_element() > 0.0 {
                list.push(Emitter { instance: i, triangle, radiance: *radiance, double_sided });
                patterns.extend(pattern.clone().map(|pattern| (i, triangle, pattern)));
            }
        }
    }
    (list, patterns)
}

/// The texture whose coordinates a material's emission follows.
fn reference(material: &Material) -> Option<&TextureRef> {
    let alpha = material.base_color_texture.as_ref().filter(|_| !material.is_opaque());
    material.emission_texture.as_ref().or(alpha)
}

impl<'a> Surfaces<'a> {
    fn mesh(&self, mesh: u32) -> &'a TriangleMesh {
        &self.geometry.meshes[mesh as usize]
    }

    fn material_of(&self, mesh: u32) -> &'a Material {
        &self.materials[self.mesh(mesh).material as usize]
    }

    fn texture(&self, reference: &TextureRef) -> Option<&'a Texture> {
        self.textures.get(reference.texture as usize)
    }

    /// The alpha texture if it lies on the surface as `other` does.
    fn alpha_along(&self, material: &'a Material, other: &TextureRef) -> Option<&'a TextureRef> {
        let alpha = material.base_color_texture.as_ref().filter(|_| !material.is_opaque())?;
        let place = |r: &TextureRef| (r.uv_set & 1, r.offset, r.rotation, r.scale);
        let wrap = |r| self.texture(r).map(|t| [t.wrap_s, t.wrap_t]);
        (place(alpha) == place(other) && wrap(alpha) == wrap(other)).then_some(alpha)
    }

    /// The table that a material needs; `None` without a texture.
    fn key(&self, material: &Material) -> Option<Key> {
        let main = reference(material)?;
        self.texture(main)?;
        let alpha = self.alpha_along(material, main).map(|alpha| {
            let cutoff = match material.alpha_mode {
                AlphaMode::Mask(cutoff) => Some(cutoff.to_bits()),
                AlphaMode::Opaque | AlphaMode::Blend => None,
            };
            (
                alpha.texture,
                material.emission_texture.is_some(),
                material.base_alpha.to_bits(),
                cutoff,
            )
        });
        Some(Key { texture: main.texture, linear: main.color_space == ColorSpace::Linear, alpha })
    }

    /// Emission without its factor, times opacity, in the plane of the texture.
    fn table(&self, material: &Material, key: Key) -> Table {
        let main = reference(material).expect("a table is made of a texture");
        let alpha = key.alpha.and_then(|(texture, ..)| self.textures.get(texture as usize));
        let emission = material.emission_texture.as_ref().and_then(|r| self.texture(r));
        let wrap = self.texture(main).map_or([Wrap::Repeat; 2], |t| [t.wrap_s, t.wrap_t]);
        let texels = |axis: usize| {
            let side = |t: &Texture| [t.image.width, t.image.height][axis];
            emission.map_or(1, side).max(alpha.map_or(1, side)) as usize
        };
        let texels = [texels(0), texels(1)];
        let block = ((texels[0] as f64 * texels[1] as f64 / CELLS).sqrt().ceil() as usize).max(1);
        let [width, height] = texels.map(|n| n.div_ceil(block));
        // A bilinear texture is linear within quarters of its texels: the middles of these have the
        // exact mean.
        let parts = 2 * block;
        let value = |uv: Vec2| {
            let color = emission.map_or(Color::ONE, |t| t.sample(uv, main.color_space).truncate());
            match alpha {
                Some(t) if color != Color::ZERO => {
                    let alpha = material.base_alpha * t.sample(uv, ColorSpace::Linear).w;
                    color * material.opacity_of(alpha)
                }
                _ => color,
            }
        };
        let step = Vec2::new((width * parts) as f32, (height * parts) as f32).recip();
        let cell = |i: usize| {
            let (x, y) = (i % width * parts, i / width * parts);
            let mut sum = Color::ZERO;
            for k in 0..parts * parts {
                let place = Vec2::new((x + k % parts) as f32, (y + k / parts) as f32) + 0.5;
                sum += value(place * step);
            }
            sum / (parts * parts) as f32
        };
        let cells: Vec<Color> = (0..width * height).into_par_iter().map(cell).collect();
        let mean = |c: &Color| (c.x + c.y + c.z) / 3.0;
        let numbers = |c: &Color| [mean(c), c.x, c.y, c.z, mean(c) * mean(c)];
        let means = || SummedTable::new([width, height], wrap, cells.iter().map(|c| [mean(c)]));
        let alike = cells.iter().all(|c| c.abs_diff_eq(cells[0], 1e-4));
        Table {
            size: [width as f64, height as f64],
            sums: SummedTable::new([width, height], wrap, cells.iter().map(numbers)),
            shared: (!alike).then(|| Arc::new(means())),
        }
    }

    /// The emission of all triangles of the mesh that `instance` shows. Triangles with the same
    /// texture coordinates are judged once.
    fn glows(&self, instance: u32, table: Option<&Table>) -> Glows {
        let mesh = self.mesh(self.geometry.instances[instance as usize].mesh);
        let material = &self.materials[mesh.material as usize];
        let main = reference(material);
        // Alpha that does not lie on the surface as the table does is asked for at points.
        let by_table = main.is_some_and(|m| self.alpha_along(material, m).is_some());
        let own_alpha =
            mesh.colors.is_some() || (material.base_color_texture.is_some() && !by_table);
        let apart = !material.is_opaque() && own_alpha;
        let triangles = 0..mesh.indices.len() as u32;
        if table.is_none() && !apart {
            let radiance = material.emission * material.opacity_of(material.base_alpha);
            return triangles.map(|_| (radiance, None)).collect();
        }
        let corners = |triangle: u32| {
            mesh.indices[triangle as usize].map(|i| {
                let uv =
                    [0, 1].map(|k| mesh.uv[k].as_ref().map_or(Vec2::ZERO, |set| set[i as usize]));
                main.map_or(Vec2::ZERO, |main| main.apply(&uv))
            })
        };
        let glow = |triangle: u32| {
            let place = table.map(|table| (table, corners(triangle)));
            self.glow(instance, triangle, place, apart)
        };
        if apart {
            return triangles.into_par_iter().map(glow).collect();
        }
        let mut first = HashMap::new();
        let mut distinct = Vec::new();
        let which: Vec<usize> = triangles
            .map(|triangle| {
                let key = corners(triangle).map(|c| c.to_array().map(f32::to_bits));
                *first.entry(key).or_insert_with(|| {
                    distinct.push(triangle);
                    distinct.len() - 1
                })
            })
            .collect();
        let distinct: Glows = distinct.into_par_iter().map(glow).collect();
        which.into_iter().map(|k| distinct[k].clone()).collect()
    }

    /// The emission of one triangle; `place` are the table and the corners in its texture.
    fn glow(
        &self, instance: u32, triangle: u32, place: Option<(&Table, [Vec2; 3])>, apart: bool,
    ) -> (Color, Option<Pattern>) {
        let mesh = self.mesh(self.geometry.instances[instance as usize].mesh);
        let material = &self.materials[mesh.material as usize];
        let Some((table, corners)) = place else {
            return (self.mean_at_points(instance, triangle, 16), None);
        };
        let size = DVec2::from_array(table.size);
        let corners = corners.map(|c| c.as_dvec2() * size);
        let [a, b, c] = corners;
        let lengths = [b - a, c - b, a - c].map(DVec2::length);
        let longest = lengths.into_iter().fold(0.0, f64::max);
        let near = corners.iter().all(|c| c.abs().max_element() < FAR);
        let (mean, pattern) = match &table.shared {
            Some(_) if near && (longest <= FEW || area(&corners) < THIN * longest) => {
                let side = (4.0 * longest).ceil().clamp(2.0, 128.0) as usize;
                return (self.mean_at_points(instance, triangle, side), None);
            }
            Some(shared) if near => {
                let [all, red, green, blue, squares] = integrals(&table.sums, corners);
                let mean = [red, green, blue].map(|sum| (sum / area(&corners)) as f32);
                // The mean of a pattern's density over its own samples.
                let contrast = squares * area(&corners) / (all * all);
                let pattern = || Pattern::new(shared.clone(), corners, all);
                (mean, if contrast >= CONTRAST { pattern() } else { None })
            }
            _ => {
                let window = [[0, 0], table.size.map(|n| n as i64)];
                let [_, red, green, blue, _] = table.sums.sums(window);
                ([red, green, blue].map(|sum| (sum / size.element_product()) as f32), None)
            }
        };
        let mut mean = material.emission * Color::from_array(mean);
        if apart {
            mean *= self.opacity_by(instance, triangle, pattern.as_ref());
        }
        (mean, pattern)
    }

    /// Emission times opacity at a point of the front of a triangle, and the opacity.
    fn at(&self, instance: u32, triangle: u32, [u, v]: [f32; 2]) -> (Color, f32) {
        let [a, b, c] = self.geometry.triangle(instance, triangle);
        let towards = -(b - a).cross(c - a).normalize_or(Vec3::Z);
        let at = interpolate(self.geometry, instance, triangle, u, v, towards);
        let material = &self.materials[at.material as usize];
        let opacity = material.opacity(self.textures, &at);
        (material.emission_at(self.textures, &at) * opacity, opacity)
    }

    /// The mean over a regular grid of points.
    fn mean_at_points(&self, instance: u32, triangle: u32, side: usize) -> Color {
        let mut sum = Color::ZERO;
        for (i, j) in (0..side).flat_map(|i| (0..side - i).map(move |j| (i, j))) {
            // The middles of the small triangles that point the way the large one does.
            let weights = [i, j].map(|k| (k as f32 + 1.0 / 3.0) / side as f32);
            sum += self.at(instance, triangle, weights).0;
        }
        sum / (side * (side + 1) / 2) as f32
    }

    /// The mean opacity where a triangle glows; not 0 unless no vertex lets anything be seen.
    fn opacity_by(&self, instance: u32, triangle: u32, pattern: Option<&Pattern>) -> f32 {
        let mesh = self.mesh(self.geometry.instances[instance as usize].mesh);
        let material = &self.materials[mesh.material as usize];
        let highest = mesh.colors.as_ref().map_or(1.0, |colors| {
            mesh.indices[triangle as usize]
                .map(|i| colors[i as usize].w)
                .into_iter()
                .fold(0.0, f32::max)
        });
        if material.opacity_of(material.base_alpha * highest) <= 0.0 {
            return 0.0;
        }
        let mut sum = 0.0;
        for k in 0..ASKED {
            let u = lattice_point(k, ASKED);
            let drawn = pattern.and_then(|p| p.inside(u));
            let weights = drawn.unwrap_or_else(|| square_to_triangle(u));
            sum += self.at(instance, triangle, weights).1;
        }
        sum.max(0.5) / ASKED as f32
    }
}
