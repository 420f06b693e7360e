//! Small glTF files made on the spot.

use lumicache::error::Result;
use lumicache::import::{ImportOptions, gltf};
use lumicache::scene::SceneData;
use serde_json::{Value, json};

/// A document with one buffer, written as a binary container.
pub struct Gltf {
    json: Value,
    bytes: Vec<u8>,
}

/// Little-endian bytes.
pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Little-endian bytes.
pub fn shorts(values: &[i16]) -> Vec<u8> {
    values.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Adds a mesh of the triangle (0 0 0), (1 0 0), (0 1 0).
pub fn triangle(file: &mut Gltf) -> usize {
    let position = file.positions(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    file.add("meshes", json!({"primitives": [{"attributes": {"POSITION": position}}]}))
}

impl Gltf {
    /// A document without contents.
    pub fn new() -> Self {
        Self { json: json!({"asset": {"version": "2.0"}}), bytes: Vec::new() }
    }

    /// Sets a top-level property.
    pub fn set(&mut self, key: &str, value: Value) {
        self.json[key] = value;
    }

    /// Sets an extension of the document.
    pub fn extension(&mut self, name: &str, value: Value) {
        self.json["extensions"][name] = value;
    }

    /// Appends to a top-level array; the index there.
    pub fn add(&mut self, array: &str, value: Value) -> usize {
        if self.json[array].is_null() {
            self.json[array] = json!([]);
        }
        let array = self.json[array].as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    /// Adds bytes and a view of them.
    pub fn view(&mut self, bytes: &[u8], stride: Option<usize>) -> usize {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()});
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        self.add("bufferViews", view)
    }

    /// Adds an accessor with a view of its own; `more` are further properties.
    pub fn accessor(
        &mut self, bytes: &[u8], component: u32, shape: &str, count: usize, more: Value,
        stride: Option<usize>,
    ) -> usize {
        let view = self.view(bytes, stride);
        let mut accessor =
            json!({"bufferView": view, "componentType": component, "type": shape, "count": count});
        for (key, value) in more.as_object().unwrap() {
            accessor[key] = value.clone();
        }
        self.add("accessors", accessor)
    }

    /// Adds an accessor of positions.
    pub fn positions(&mut self, values: &[f32]) -> usize {
        self.accessor(&floats(values), 5126, "VEC3", values.len() / 3, json!({}), None)
    }

    /// Adds a node.
    pub fn node(&mut self, node: Value) -> usize {
        self.add("nodes", node)
    }

    /// Adds a scene of nodes.
    pub fn scene(&mut self, nodes: &[usize]) {
        self.add("scenes", json!({"nodes": nodes}));
    }

    /// Adds a mesh of one primitive and a node that shows it.
    pub fn show(&mut self, primitive: Value) {
        let mesh = self.add("meshes", json!({"primitives": [primitive]}));
        self.node(json!({"mesh": mesh}));
    }

    /// The document as it stands.
    pub fn document(&self) -> &Value {
        &self.json
    }

    /// The file's bytes.
    pub fn glb(&self) -> Vec<u8> {
        self.glb_of(&self.json)
    }

    /// The bytes of a file with another document and the same buffer.
    pub fn glb_of(&self, document: &Value) -> Vec<u8> {
        let mut json = document.clone();
        if !self.bytes.is_empty() {
            json["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        }
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut chunks = vec![(0x4E4F_534Au32, text)];
        if !self.bytes.is_empty() {
            chunks.push((0x004E_4942, self.bytes.clone()));
        }
        let length: usize = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
        let mut file =
            [b"glTF".as_slice(), &2u32.to_le_bytes(), &(length as u32).to_le_bytes()].concat();
        for (kind, data) in chunks {
            file.extend((data.len() as u32).to_le_bytes());
            file.extend(kind.to_le_bytes());
            file.extend(data);
        }
        file
    }

    /// Writes and imports the file.
    pub fn try_load(&self, options: &ImportOptions) -> Result<SceneData> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("made.glb");
        std::fs::write(&path, self.glb()).unwrap();
        gltf(&path, options)
    }

    /// As [`Gltf::try_load`], which must succeed.
    pub fn load_with(&self, options: &ImportOptions) -> SceneData {
        self.try_load(options).unwrap_or_else(|e| panic!("{e}"))
    }

    /// As [`Gltf::load_with`] with the default options.
    pub fn load(&self) -> SceneData {
        self.load_with(&ImportOptions::default())
    }
}
