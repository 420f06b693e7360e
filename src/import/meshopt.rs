//! EXT_meshopt_compression and its successor KHR_meshopt_compression: compressed buffer views.

use super::budget::Budget;
use super::fault::{Fault, Parsed};
use super::value::index;
use serde_json::Value;

/// The names of the extension.
pub(super) const NAMES: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];

/// A compressed buffer view as the document describes it.
pub(super) struct Compressed<'a> {
    /// JSON path of the extension.
    pub path: String,
    /// Index of the buffer with the compressed bytes.
    pub buffer: usize,
    /// Where they begin.
    pub offset: u64,
    /// How many they are.
    pub length: u64,
    stride: u64,
    count: u64,
    mode: &'a str,
    filter: &'a str,
}

/// The name and the object of the extension.
fn extension(object: &Value) -> Option<(&'static str, &Value)> {
    let extensions = &object["extensions"];
    NAMES.into_iter().find_map(|name| Some((name, extensions.get(name)?)))
}

/// True for a buffer that only stands for the decompressed bytes.
pub(super) fn is_fallback(buffer: &Value) -> bool {
    extension(buffer).is_some_and(|(_, json)| json["fallback"] == true)
}

impl<'a> Compressed<'a> {
    /// The compression of the buffer view at the JSON path `at`, `None` if it is stored plainly.
    pub fn of(view: &'a Value, at: &str) -> Parsed<Option<Self>> {
        let Some((name, json)) = extension(view) else { return Ok(None) };
        let number = |key: &str| json[key].as_u64().unwrap_or(0);
        let this = Self {
            path: format!("{at}/extensions/{name}"),
            buffer: index(&json["buffer"]).unwrap_or(0),
            offset: number("byteOffset"),
            length: number("byteLength"),
            stride: number("byteStride"),
            count: number("count"),
            mode: json["mode"].as_str().unwrap_or(""),
            filter: json["filter"].as_str().unwrap_or("NONE"),
        };
        this.check()?;
        Ok(Some(this))
    }

    fn fault(&self, key: &str, what: String) -> Fault {
        Fault::new(format!("{}{key}", self.path), what)
    }

    fn check(&self) -> Parsed<()> {
        let Self { stride, mode, filter, .. } = self;
        let stride_fits = match *mode {
            "ATTRIBUTES" => stride % 4 == 0 && (4..=256).contains(stride),
            _ => [2, 4].contains(stride),
        };
        if !stride_fits {
            return Err(self.fault("/byteStride", format!("{stride} does not suit the mode")));
        }
        if *mode == "TRIANGLES" && !self.count.is_multiple_of(3) {
            return Err(self.fault("/count", format!("{} is not a multiple of 3", self.count)));
        }
        let filter_fits = match *filter {
            "NONE" => true,
            "OCTAHEDRAL" | "COLOR" => [4, 8].contains(stride),
            "QUATERNION" => *stride == 8,
            _ => stride % 4 == 0,
        };
        if !filter_fits || (*filter != "NONE" && *mode != "ATTRIBUTES") {
            let what = format!("it does not suit the mode or the stride {stride}");
            return Err(self.fault("/filter", what));
        }
        Ok(())
    }

    /// Decompresses `source` to the `length` bytes of the view.
    pub fn decode(&self, source: &[u8], length: u64, budget: &mut Budget) -> Parsed<Vec<u8>> {
        use ::meshopt::{decode_index_buffer, decode_index_sequence};
        let Self { stride, count, .. } = self;
        if stride.checked_mul(*count) != Some(length) {
            let what = format!(
                "{count} elements of {stride} bytes are not the {length} bytes of the view"
            );
            return Err(self.fault("", what));
        }
        // The fewest bytes that the formats need: a byte for each triangle or index, 2 bits for 256
        // bytes of vertices.
        let most = match self.mode {
            "TRIANGLES" => 3 * source.len() as u64,
            "INDICES" => source.len() as u64,
            _ => (1024 * source.len() as u64) / stride,
        };
        if *count > most {
            let what = format!("{} compressed bytes cannot hold {count} elements", source.len());
            return Err(self.fault("/count", what));
        }
        budget.spend(*count, *stride, &self.path)?;
        let n = *count as usize;
        let bytes = match (self.mode, stride) {
            ("TRIANGLES", 2) => decode_index_buffer::<u16>(source, n).map(|v| to_bytes(&v)),
            ("TRIANGLES", _) => decode_index_buffer::<u32>(source, n).map(|v| to_bytes(&v)),
            ("INDICES", 2) => decode_index_sequence::<u16>(source, n).map(|v| to_bytes(&v)),
            ("INDICES", _) => decode_index_sequence::<u32>(source, n).map(|v| to_bytes(&v)),
            _ => vertices(source, n, *stride as usize),
        };
        let mut bytes =
            bytes.map_err(|_| self.fault("", "the compressed data is broken".into()))?;
        self.unfilter(&mut bytes);
        Ok(bytes)
    }

    fn unfilter(&self, bytes: &mut [u8]) {
        use ::meshopt::{
            decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat,
        };
        match (self.filter, self.stride) {
            ("OCTAHEDRAL", 4) => in_place::<[i8; 4]>(bytes, decode_filter_oct),
            ("OCTAHEDRAL", _) => in_place::<[i16; 4]>(bytes, decode_filter_oct),
            ("QUATERNION", _) => in_place::<[i16; 4]>(bytes, decode_filter_quat),
            ("EXPONENTIAL", _) => in_place::<[u32; 1]>(bytes, decode_filter_exp),
            ("COLOR", 4) => in_place::<[u8; 4]>(bytes, decode_filter_color),
            ("COLOR", _) => in_place::<[u16; 4]>(bytes, decode_filter_color),
            _ => {}
        }
    }
}

/// Runs a filter over bytes that are elements of type `T`; they are copied because bytes need not
/// be aligned for `T`.
fn in_place<T: bytemuck::Pod>(bytes: &mut [u8], filter: impl FnOnce(&mut [T])) {
    let mut elements: Vec<T> = bytemuck::pod_collect_to_vec(bytes);
    filter(&mut elements);
    bytes.copy_from_slice(bytemuck::cast_slice(&elements));
}

fn to_bytes<T: bytemuck::NoUninit>(elements: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(elements).to_vec()
}

/// A vertex of a size known to the compiler, which is how the decoder's binding learns it.
#[derive(Clone)]
struct Vertex<const WORDS: usize>([u32; WORDS]);

impl<const WORDS: usize> Default for Vertex<WORDS> {
    fn default() -> Self {
        Self([0; WORDS])
    }
}

fn vertices_of<const WORDS: usize>(source: &[u8], count: usize) -> ::meshopt::Result<Vec<u8>> {
    let vertices = ::meshopt::decode_vertex_buffer::<Vertex<WORDS>>(source, count)?;
    let mut bytes = Vec::with_capacity(count * WORDS * 4);
    for vertex in &vertices {
        bytes.extend_from_slice(bytemuck::cast_slice(&vertex.0));
    }
    Ok(bytes)
}

/// Calls [`vertices_of`] with the number of words in a stride, which is one of those listed.
macro_rules! with_words {
    ($source:expr, $count:expr, $words:expr; $($n:literal)*) => {
        match $words {
            $($n => vertices_of::<$n>($source, $count),)*
            _ => Err(::meshopt::Error::Parse("unsupported vertex size".into())),
        }
    };
}

fn vertices(source: &[u8], count: usize, stride: usize) -> ::meshopt::Result<Vec<u8>> {
    with_words!(source, count, stride / 4;
        1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32
        33 34 35 36 37 38 39 40 41 42 43 44 45 46 47 48 49 50 51 52 53 54 55 56 57 58 59 60 61 62 63 64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::meshopt as codec;
    use serde_json::{Value, json};

    fn decode(mut extension: Value, source: &[u8]) -> Parsed<Vec<u8>> {
        extension["buffer"] = json!(0);
        extension["byteLength"] = json!(source.len());
        let length =
            extension["byteStride"].as_u64().unwrap() * extension["count"].as_u64().unwrap();
        let view = json!({"extensions": {"KHR_meshopt_compression": extension}});
        let compressed = Compressed::of(&view, "")?.unwrap();
        compressed.decode(source, length, &mut Budget::new(None))
    }

    #[test]
    fn every_mode_returns_what_was_encoded() {
        let indices: Vec<u32> = (0..300).map(|i| i / 3 + i % 3).collect();
        let short: Vec<u16> = indices.iter().map(|i| *i as u16).collect();
        let triangles = codec::encode_index_buffer(&indices, 102).unwrap();
        let sequence = codec::encode_index_sequence(&indices, 102).unwrap();
        for (mode, source) in [("TRIANGLES", &triangles), ("INDICES", &sequence)] {
            let read = |stride: u32| {
                decode(json!({"mode": mode, "byteStride": stride, "count": 300}), source).unwrap()
            };
            let (wide, narrow) = (read(4), read(2));
            let wide: Vec<u32> = bytemuck::pod_collect_to_vec(&wide);
            let narrow: Vec<u16> = bytemuck::pod_collect_to_vec(&narrow);
            if mode == "INDICES" {
                assert_eq!((&wide, &narrow), (&indices, &short));
            }
            // The encoder of triangles may rotate their corners.
            let canonical =
                |t: &[u32]| (0..3).map(|k| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]).min().unwrap();
            let sets =
                [&wide, &indices].map(|all| all.chunks(3).map(canonical).collect::<Vec<_>>());
            assert_eq!(sets[0], sets[1]);
            assert!(wide.iter().zip(&narrow).all(|(a, b)| *a == u32::from(*b)));
        }
        let vertices: Vec<[f32; 5]> =
            (0..500).map(|i| [i as f32, 0.5, -(i as f32) / 7.0, 1e9, 0.0]).collect();
        let source = codec::encode_vertex_buffer(&vertices).unwrap();
        let bytes =
            decode(json!({"mode": "ATTRIBUTES", "byteStride": 20, "count": 500}), &source).unwrap();
        assert_eq!(bytes, bytemuck::cast_slice::<_, u8>(&vertices));
    }

    #[test]
    fn every_filter_is_undone() {
        let check = |filter: &str,
                     encoded: Vec<u8>,
                     stride: usize,
                     one: f32,
                     wanted: &[f32],
                     e: f32| {
            let json =
                json!({"mode": "ATTRIBUTES", "filter": filter, "byteStride": stride, "count": 3});
            let bytes = decode(json, &encoded).unwrap();
            let signed = ["OCTAHEDRAL", "QUATERNION"].contains(&filter);
            let got = bytes.chunks(3 * stride / wanted.len()).map(|c| match (c.len(), signed) {
                (1, true) => f32::from(c[0] as i8) / one,
                (1, false) => f32::from(c[0]) / one,
                (2, true) => f32::from(i16::from_le_bytes([c[0], c[1]])) / one,
                (2, false) => f32::from(u16::from_le_bytes([c[0], c[1]])) / one,
                _ => f32::from_le_bytes([c[0], c[1], c[2], c[3]]),
            });
            for (got, wanted) in got.zip(wanted) {
                let close = (got - wanted).abs() <= e * wanted.abs().max(one.min(1.0));
                assert!(close, "{filter}: {got} and {wanted}");
            }
        };
        fn packed<T: Clone + Default>(vertices: &[T]) -> Vec<u8> {
            codec::encode_vertex_buffer(vertices).unwrap()
        }
        let axes = [[1.0f32, 0.0, 0.0, 0.0], [0.0, 0.6, -0.8, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let narrow = packed(&codec::encode_filter_oct::<i8>(&axes, 8));
        check("OCTAHEDRAL", narrow, 4, 127.0, axes.as_flattened(), 0.02);
        let wide = packed(&codec::encode_filter_oct::<i16>(&axes, 16));
        check("OCTAHEDRAL", wide, 8, 32767.0, axes.as_flattened(), 1e-3);
        let turns = [[0.0f32, 0.0, 0.0, 1.0], [0.5, 0.5, 0.5, 0.5], [0.0, 0.6, 0.0, 0.8]];
        let source = packed(&codec::encode_filter_quat(&turns, 14));
        check("QUATERNION", source, 8, 32767.0, turns.as_flattened(), 1e-3);
        // 24 bits are a mantissa of 23 with its sign.
        let points = [[1.5f32, -200.0, 0.001], [0.0, 7.0, 1e6], [-1.0, 2.0, 3.0]];
        let mode = codec::EncodeExpMode::Separate;
        let source = packed(&codec::encode_filter_exp::<3>(&points, 24, mode));
        check("EXPONENTIAL", source, 12, 0.0, points.as_flattened(), 1e-6);
        let colors = [[1.0f32, 0.0, 0.0, 1.0], [0.2, 0.4, 0.6, 0.8], [1.0, 1.0, 1.0, 0.0]];
        let narrow = packed(&codec::encode_filter_color::<u8>(&colors, 8));
        check("COLOR", narrow, 4, 255.0, colors.as_flattened(), 0.02);
        let wide = packed(&codec::encode_filter_color::<u16>(&colors, 16));
        check("COLOR", wide, 8, 65535.0, colors.as_flattened(), 1e-3);
    }

    #[test]
    fn broken_and_exaggerated_data_are_errors() {
        let source = codec::encode_vertex_buffer(&[[1u32, 2, 3]; 100]).unwrap();
        let read = |source: &[u8], stride: u64, count: u64| {
            decode(json!({"mode": "ATTRIBUTES", "byteStride": stride, "count": count}), source)
        };
        assert!(read(&source, 12, 100).is_ok());
        for n in 1..source.len() {
            assert!(read(&source[..n], 12, 100).is_err(), "{n}");
        }
        assert!(read(&source, 12, 1_000_000_000).unwrap_err().what.contains("cannot hold"));
        assert!(read(&source, 10, 100).is_err() && read(&source, 260, 4).is_err());
        for (mode, count) in
            [("TRIANGLES", 3_000_000_000u64), ("INDICES", 1_000_000_000), ("TRIANGLES", 4)]
        {
            assert!(
                decode(json!({"mode": mode, "byteStride": 4, "count": count}), &source).is_err(),
                "{mode} {count}"
            );
        }
        assert!(
            decode(
                json!({"mode": "INDICES", "byteStride": 4, "count": 3, "filter": "COLOR"}),
                &source
            )
            .is_err()
        );
    }
}
