//! What the parts of a document that are read must be like [glTF20, 5], and those of extensions.

use Kind::*;
use Unknown::*;
use std::f64::consts::FRAC_PI_2;

/// What a value must be.
pub(super) enum Kind {
    Any,
    Flag,
    Text,
    /// One of these words.
    Names(&'static [&'static str], Unknown),
    /// One of these integers.
    Codes(&'static [u64], Unknown),
    /// A number of this range that single precision can hold.
    Number(f64, f64),
    /// A number above 0.
    Positive,
    /// A number of this range for all channels, or one for each.
    Channels(f64, f64),
    /// An integer of at least 0.
    Integer,
    /// The number of a set of texture coordinates.
    Set,
    /// An integer of at least 1.
    Count,
    /// An index into this array of [`ARRAYS`].
    To(&'static str),
    /// The same; beyond its end it is an error only where something is shown by it.
    Perhaps(&'static str),
    /// An array; an empty one is mended where so many values are 0, else an error.
    List(&'static Kind, usize),
    /// An array of exactly so many values.
    Tuple(&'static Kind, usize),
    /// An object; other properties go unread.
    Object(&'static [Field]),
    /// This object, without other properties.
    Closed(&'static Kind),
    /// This object, of which nothing is read.
    Unread(&'static Kind),
    /// The attributes of a primitive.
    Attributes,
    /// Anything; if it is an object with the property `lumicache`, this is what that must be.
    Extras(&'static Kind),
    /// An object; if it has the property `ies`, this is what it must be, without others.
    Luminaire(&'static Kind),
    /// A BRDF of our own.
    Brdf,
}

/// What becomes of a word or a number that the specification does not know.
#[derive(Clone, Copy)]
pub(super) enum Unknown {
    Refused,
    /// The first of the known ones stands in its place, and a warning says so.
    First,
    /// It stays, and a warning says that what has it is left out.
    Kept,
}

/// Whether a property must be there.
#[derive(Clone, Copy)]
pub(super) enum Need {
    May,
    Must,
    /// An absent array is an empty one.
    List,
}

/// A property of an object.
pub(super) struct Field {
    pub name: &'static str,
    pub need: Need,
    pub kind: Kind,
}

const NUMBER: Kind = Number(f64::NEG_INFINITY, f64::INFINITY);
const UNIT: Kind = Number(0.0, 1.0);
const UNSIGNED: Kind = Number(0.0, f64::INFINITY);
const RGB: Kind = Tuple(&UNSIGNED, 3);
const ACCESSORS: Kind = To("accessors");
const NODES: Kind = To("nodes");
const IMAGES: Kind = Perhaps("images");
const TEXTURES: Kind = To("textures");
const VIEWS: Kind = To("bufferViews");
const IES_LIGHTS: &str = "extensions/EXT_lights_ies/lights";
const LIGHTS: &str = "extensions/KHR_lights_punctual/lights";

/// The arrays that indices point into.
#[rustfmt::skip]
pub(super) const ARRAYS: [&str; 14] = [
    "accessors", "bufferViews", "buffers", "cameras", "images", "materials", "meshes", "nodes",
    "samplers", "scenes", "skins", "textures", LIGHTS, IES_LIGHTS,
];

/// Extensions whose objects may stand where a schema names them and nowhere else.
#[rustfmt::skip]
pub(super) const PLACED: [&str; 27] = [
    "EXT_lights_ies", "EXT_mesh_gpu_instancing", "EXT_meshopt_compression", "EXT_texture_avif",
    "EXT_texture_webp", "KHR_draco_mesh_compression", "KHR_lights_punctual",
    "KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion", "KHR_materials_emissive_strength", "KHR_materials_ior",
    "KHR_materials_iridescence", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_sheen",
    "KHR_materials_specular", "KHR_materials_subsurface", "KHR_materials_transmission",
    "KHR_materials_unlit", "KHR_materials_variants", "KHR_materials_volume",
    "KHR_mesh_quantization", "KHR_meshopt_compression", "KHR_texture_basisu",
    "KHR_texture_transform", "MSFT_texture_dds",
];

/// The vertex attributes that are read, beside joints and weights.
pub(super) const ATTRIBUTES: [&str; 6] =
    ["POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0"];

/// Attributes of which a primitive may have several, numbered from 0.
pub(super) const SETS: [&str; 4] = ["TEXCOORD_", "COLOR_", "JOINTS_", "WEIGHTS_"];

/// Declares kinds of objects by their properties; one with `[!]` must be there, and one with `[+]`
/// is an empty array where it is absent.
macro_rules! objects {
    ($($name:ident: $($field:ident $([$need:tt])? = $kind:expr),*;)*) => {
        $(pub(super) const $name: Kind = Object(&[
            $(Field { name: stringify!($field), need: need!($($need)?), kind: $kind }),*
        ]);)*
    };
}

macro_rules! need {
    () => {
        Need::May
    };
    (!) => {
        Need::Must
    };
    (+) => {
        Need::List
    };
}

objects! {
    ROOT: asset[!] = ASSET, extensionsUsed = List(&Text, 0), extensionsRequired = List(&Text, 0),
        extensions = ROOT_EXTENSIONS, scene = To("scenes"), scenes = List(&SCENE, 0),
        nodes = List(&NODE, 0), meshes = List(&MESH, 0), accessors = List(&ACCESSOR, 0),
        buffers = List(&BUFFER, 0), bufferViews = List(&BUFFER_VIEW, 0), skins = List(&SKIN, 0),
        materials = List(&MATERIAL, 0), textures = List(&TEXTURE, 0), images = List(&IMAGE, 0),
        samplers = List(&SAMPLER, 0), cameras = List(&CAMERA, 0),
        animations = List(&ANIMATION, 0);
    ONLY_ASSET: asset[!] = ASSET;
    ASSET: version[!] = Text, minVersion = Text;
    ROOT_EXTENSIONS: KHR_lights_punctual = LIGHT_LIST, EXT_lights_ies = IES_LIST,
        KHR_materials_variants = PRESENT;
    LIGHT_LIST: lights[+] = List(&LIGHT, 0);
    IES_LIST: lights[+] = List(&IES_LIGHT, 0);

    SCENE: name = Text, nodes[+] = List(&NODES, 0);
    NODE: name = Text, children = List(&NODES, 0), matrix = Tuple(&NUMBER, 16),
        translation = Tuple(&NUMBER, 3), rotation = Tuple(&NUMBER, 4), scale = Tuple(&NUMBER, 3),
        mesh = To("meshes"), skin = To("skins"), camera = To("cameras"),
        weights = List(&NUMBER, 0), extensions = NODE_EXTENSIONS,
        extras = Extras(&Luminaire(&NODE_LUMINAIRE));
    NODE_EXTENSIONS: KHR_lights_punctual = NODE_LIGHT, EXT_lights_ies = NODE_IES,
        EXT_mesh_gpu_instancing = INSTANCING;
    NODE_LIGHT: light[!] = To(LIGHTS);
    NODE_IES: light[!] = To(IES_LIGHTS), multiplier = UNSIGNED, color = Tuple(&UNIT, 3);
    INSTANCING: attributes[!] = INSTANCES;
    INSTANCES: TRANSLATION = ACCESSORS, ROTATION = ACCESSORS, SCALE = ACCESSORS;
    SKIN: name = Text, skeleton = NODES, joints[!] = List(&NODES, 1),
        inverseBindMatrices = ACCESSORS;

    MESH: name = Text, primitives[!] = List(&PRIMITIVE, 0), weights[+] = List(&NUMBER, 0);
    PRIMITIVE: attributes[!] = Attributes, indices = ACCESSORS, material = To("materials"),
        mode = Codes(&[0, 1, 2, 3, 4, 5, 6], Refused), targets[+] = List(&Attributes, 0),
        extensions = PRIMITIVE_EXTENSIONS;
    PRIMITIVE_EXTENSIONS: KHR_draco_mesh_compression = Unread(&DRACO),
        KHR_materials_variants = Unread(&VARIANTS);
    DRACO: bufferView[!] = VIEWS;
    VARIANTS: mappings[!] = List(&MAPPING, 0);
    MAPPING: material[!] = To("materials");
    PRESENT: ;
    ACCESSOR: name = Text, bufferView = VIEWS, byteOffset = Integer, count[!] = Count,
        componentType[!] = Codes(&[5120, 5121, 5122, 5123, 5125, 5126], Kept),
        type[!] = Names(&["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"], Kept),
        normalized = Flag, min = List(&NUMBER, 0), max = List(&NUMBER, 0), sparse = SPARSE;
    SPARSE: count[!] = Count, indices[!] = SPARSE_INDICES, values[!] = SPARSE_VALUES;
    SPARSE_INDICES: bufferView[!] = VIEWS, byteOffset = Integer,
        componentType[!] = Codes(&[5121, 5123, 5125], Refused);
    SPARSE_VALUES: bufferView[!] = VIEWS, byteOffset = Integer;
    BUFFER: name = Text, byteLength[!] = Count, uri = Text, extensions = BUFFER_EXTENSIONS;
    BUFFER_EXTENSIONS: EXT_meshopt_compression = FALLBACK, KHR_meshopt_compression = FALLBACK;
    FALLBACK: fallback = Flag;
    BUFFER_VIEW: name = Text, buffer[!] = To("buffers"), byteLength[!] = Count, byteOffset = Integer,
        byteStride = Integer, target = Integer, extensions = VIEW_EXTENSIONS;
    VIEW_EXTENSIONS: EXT_meshopt_compression = MESHOPT, KHR_meshopt_compression = MESHOPT;
    MESHOPT: buffer[!] = To("buffers"), byteOffset = Integer, byteLength[!] = Count,
        byteStride[!] = Count, count[!] = Count,
        mode[!] = Names(&["ATTRIBUTES", "TRIANGLES", "INDICES"], Refused),
        filter = Names(&["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"], Refused);

    CAMERA: name = Text, type[!] = Names(&["perspective", "orthographic"], Kept),
        perspective = PERSPECTIVE, orthographic = ORTHOGRAPHIC;
    PERSPECTIVE: yfov[!] = Positive, znear[!] = Positive, zfar = Positive, aspectRatio = Positive;
    ORTHOGRAPHIC: xmag[!] = NUMBER, ymag[!] = NUMBER, znear[!] = UNSIGNED, zfar[!] = NUMBER;
    ANIMATION: name = Text, samplers[+] = List(&ANIMATION_SAMPLER, 0),
        channels[+] = List(&CHANNEL, 0);
    ANIMATION_SAMPLER: input[!] = ACCESSORS, output[!] = ACCESSORS,
        interpolation = Names(&["LINEAR", "STEP", "CUBICSPLINE"], Refused);
    CHANNEL: sampler[!] = Integer, target[!] = TARGET;
    TARGET: node = NODES, path[!] = Text;
    LIGHT: name = Text, type[!] = Names(&["point", "spot", "directional"], Kept), color = RGB,
        intensity = UNSIGNED, range = Positive, spot = SPOT,
        extras = Extras(&Luminaire(&LIGHT_LUMINAIRE));
    SPOT: outerConeAngle = Number(0.0, FRAC_PI_2), innerConeAngle = Number(0.0, FRAC_PI_2);
    IES_LIGHT: name = Text, uri = Text, bufferView = VIEWS, mimeType = Text;

    IMAGE: name = Text, uri = Text, bufferView = VIEWS, mimeType = Text;
    SAMPLER: name = Text, magFilter = Codes(&[9729, 9728], First),
        minFilter = Codes(&[9987, 9728, 9729, 9984, 9985, 9986], First),
        wrapS = Codes(&[10497, 33071, 33648], First),
        wrapT = Codes(&[10497, 33071, 33648], First);
    TEXTURE: name = Text, sampler = To("samplers"), source = IMAGES,
        extensions = TEXTURE_EXTENSIONS;
    TEXTURE_EXTENSIONS: EXT_texture_webp = OTHER_IMAGE, KHR_texture_basisu = OTHER_IMAGE,
        MSFT_texture_dds = OTHER_IMAGE, EXT_texture_avif = OTHER_IMAGE;
    OTHER_IMAGE: source = IMAGES;
    // A normal texture has a scale, and the others have none.
    TEXTURE_INFO: index[!] = TEXTURES, texCoord = Set, scale = NUMBER,
        extensions = INFO_EXTENSIONS;
    INFO_EXTENSIONS: KHR_texture_transform = TRANSFORM;
    TRANSFORM: offset = Tuple(&NUMBER, 2), rotation = NUMBER, scale = Tuple(&NUMBER, 2),
        texCoord = Set;

    // The specification ends the emission at 1 and leaves more to an extension; exporters do not.
    MATERIAL: name = Text, pbrMetallicRoughness = METALLIC_ROUGHNESS,
        normalTexture = TEXTURE_INFO, occlusionTexture = OCCLUSION, emissiveFactor = RGB,
        emissiveTexture = TEXTURE_INFO, alphaCutoff = UNSIGNED,
        alphaMode = Names(&["OPAQUE", "MASK", "BLEND"], First), doubleSided = Flag,
        extensions = MATERIAL_EXTENSIONS, extras = Extras(&Brdf);
    METALLIC_ROUGHNESS: baseColorFactor = Tuple(&UNIT, 4), baseColorTexture = TEXTURE_INFO,
        metallicFactor = UNIT, roughnessFactor = UNIT, metallicRoughnessTexture = TEXTURE_INFO;
    OCCLUSION: index[!] = TEXTURES, strength = UNIT, extensions = INFO_EXTENSIONS;
    MATERIAL_EXTENSIONS: KHR_materials_clearcoat = CLEARCOAT,
        KHR_materials_emissive_strength = EMISSIVE_STRENGTH, KHR_materials_ior = IOR,
        KHR_materials_pbrSpecularGlossiness = SPECULAR_GLOSSINESS,
        KHR_materials_specular = SPECULAR, KHR_materials_transmission = TRANSMISSION,
        KHR_materials_unlit = PRESENT, KHR_materials_volume = VOLUME,
        KHR_materials_anisotropy = Unread(&ANISOTROPY),
        KHR_materials_diffuse_transmission = Unread(&DIFFUSE_TRANSMISSION),
        KHR_materials_dispersion = PRESENT, KHR_materials_iridescence = Unread(&IRIDESCENCE),
        KHR_materials_sheen = Unread(&SHEEN), KHR_materials_subsurface = PRESENT;
    ANISOTROPY: anisotropyTexture = TEXTURE_INFO;
    DIFFUSE_TRANSMISSION: diffuseTransmissionTexture = TEXTURE_INFO,
        diffuseTransmissionColorTexture = TEXTURE_INFO;
    IRIDESCENCE: iridescenceTexture = TEXTURE_INFO, iridescenceThicknessTexture = TEXTURE_INFO;
    SHEEN: sheenColorTexture = TEXTURE_INFO, sheenRoughnessTexture = TEXTURE_INFO;
    CLEARCOAT: clearcoatFactor = UNIT, clearcoatTexture = TEXTURE_INFO,
        clearcoatRoughnessFactor = UNIT, clearcoatRoughnessTexture = TEXTURE_INFO,
        clearcoatNormalTexture = Unread(&TEXTURE_INFO);
    EMISSIVE_STRENGTH: emissiveStrength = UNSIGNED;
    IOR: ior = NUMBER;
    SPECULAR_GLOSSINESS: diffuseFactor = Tuple(&UNIT, 4), diffuseTexture = TEXTURE_INFO,
        specularFactor = Tuple(&UNIT, 3), glossinessFactor = UNIT,
        specularGlossinessTexture = TEXTURE_INFO;
    SPECULAR: specularFactor = UNIT, specularTexture = TEXTURE_INFO, specularColorFactor = RGB,
        specularColorTexture = TEXTURE_INFO;
    TRANSMISSION: transmissionFactor = UNIT, transmissionTexture = TEXTURE_INFO;
    VOLUME: thicknessFactor = UNSIGNED, attenuationColor = Tuple(&UNIT, 3),
        attenuationDistance = Positive, thicknessTexture = TEXTURE_INFO;

    // Our own extras, which `super` documents.
    NODE_LUMINAIRE: ies[!] = Text, multiplier = UNSIGNED, color = Tuple(&UNIT, 3);
    LIGHT_LUMINAIRE: ies[!] = Text, multiplier = UNSIGNED, relative = Flag;
    BRDF: brdf[!] = Names(&["phong", "ward", "lafortune"], Refused);
    PHONG: brdf[!] = Any, kd = Channels(0.0, 1.0), ks = Channels(0.0, 1.0), exponent[!] = UNSIGNED;
    WARD: brdf[!] = Any, kd = Channels(0.0, 1.0), ks = Channels(0.0, 1.0), alpha_x[!] = Positive,
        alpha_y = Positive;
    LAFORTUNE: brdf[!] = Any, kd = Channels(0.0, 1.0), lobes[!] = List(&Closed(&LOBE), 1);
    LOBE: cx[!] = Channels(f64::NEG_INFINITY, f64::INFINITY),
        cy = Channels(f64::NEG_INFINITY, f64::INFINITY),
        cz[!] = Channels(f64::NEG_INFINITY, f64::INFINITY),
        exponent[!] = Channels(0.0, f64::INFINITY);
}
