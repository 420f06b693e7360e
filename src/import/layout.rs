//! How the elements of an accessor lie in memory [glTF20, 3.6.2].

/// The type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    /// From the number that the document uses.
    pub fn from_code(code: u64) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// Size in bytes.
    pub fn size(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// What an integer is divided by when it is normalised; `None` where that is not allowed.
    pub fn normalizer(self) -> Option<f64> {
        match self {
            Self::I8 => Some(127.0),
            Self::U8 => Some(255.0),
            Self::I16 => Some(32767.0),
            Self::U16 => Some(65535.0),
            Self::U32 | Self::F32 => None,
        }
    }

    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::I8 => "BYTE",
            Self::U8 => "UNSIGNED_BYTE",
            Self::I16 => "SHORT",
            Self::U16 => "UNSIGNED_SHORT",
            Self::U32 => "UNSIGNED_INT",
            Self::F32 => "FLOAT",
        }
    }

    /// The component at the start of `bytes`, exactly; `bytes` has at least [`Component::size`]
    /// bytes.
    fn read(self, bytes: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            Self::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        }
    }
}

/// How components make an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shape {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    Mat2,
    Mat3,
    Mat4,
}

impl Shape {
    /// From the name that the document uses.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "SCALAR" => Self::Scalar,
            "VEC2" => Self::Vec2,
            "VEC3" => Self::Vec3,
            "VEC4" => Self::Vec4,
            "MAT2" => Self::Mat2,
            "MAT3" => Self::Mat3,
            "MAT4" => Self::Mat4,
            _ => return None,
        })
    }

    /// Columns and rows.
    fn size(self) -> (u64, u64) {
        match self {
            Self::Scalar => (1, 1),
            Self::Vec2 => (1, 2),
            Self::Vec3 => (1, 3),
            Self::Vec4 => (1, 4),
            Self::Mat2 => (2, 2),
            Self::Mat3 => (3, 3),
            Self::Mat4 => (4, 4),
        }
    }

    /// True for matrices.
    pub fn is_matrix(self) -> bool {
        self.size().0 > 1
    }

    /// Number of components.
    pub fn components(self) -> usize {
        (self.size().0 * self.size().1) as usize
    }
}

/// Component type and shape together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub component: Component,
    pub shape: Shape,
}

impl Layout {
    /// Bytes from the start of one matrix column to the next: columns begin at multiples of 4.
    fn column(self) -> u64 {
        let bytes = self.shape.size().1 * self.component.size();
        if self.shape.is_matrix() { bytes.next_multiple_of(4) } else { bytes }
    }

    /// Bytes from the start of an element to the end of its last component.
    pub fn element(self) -> u64 {
        let (columns, rows) = self.shape.size();
        (columns - 1) * self.column() + rows * self.component.size()
    }

    /// Distance of elements that follow each other closely.
    pub fn packed_stride(self) -> u64 {
        self.shape.size().0 * self.column()
    }

    /// Start of component `k` (columns first) in an element.
    fn component_offset(self, k: usize) -> usize {
        let size = self.component.size() as usize;
        if !self.shape.is_matrix() {
            return k * size;
        }
        let rows = self.shape.size().1 as usize;
        k / rows * self.column() as usize + k % rows * size
    }
}

/// Elements in memory, whose range has been checked.
#[derive(Clone, Copy)]
pub(super) struct Strided<'a> {
    /// The bytes from the first element on.
    pub bytes: &'a [u8],
    /// Distance of elements.
    pub stride: usize,
    /// What they are.
    pub layout: Layout,
}

impl Strided<'_> {
    /// Component `k` of element `i`, exactly as stored.
    #[inline]
    pub fn get(&self, i: usize, k: usize) -> f64 {
        self.layout.component.read(&self.bytes[i * self.stride + self.layout.component_offset(k)..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_columns_are_padded() {
        for (component, shape, stride, element) in [
            (Component::I8, Shape::Mat2, 8, 6),
            (Component::U8, Shape::Mat3, 12, 11),
            (Component::I16, Shape::Mat3, 24, 22),
            (Component::U16, Shape::Mat4, 32, 32),
            (Component::F32, Shape::Mat4, 64, 64),
            (Component::U8, Shape::Vec3, 3, 3),
        ] {
            let layout = Layout { component, shape };
            assert_eq!((layout.packed_stride(), layout.element()), (stride, element), "{layout:?}");
        }
        let bytes: Vec<u8> = (0..12).collect();
        let matrix = Strided {
            bytes: &bytes,
            stride: 12,
            layout: Layout { component: Component::U8, shape: Shape::Mat3 },
        };
        let values: Vec<f64> = (0..9).map(|k| matrix.get(0, k)).collect();
        assert_eq!(values, [0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 8.0, 9.0, 10.0]);
    }

    #[test]
    fn components_are_read_exactly() {
        let read = |component, bytes: &[u8]| {
            Strided {
                bytes,
                stride: bytes.len(),
                layout: Layout { component, shape: Shape::Scalar },
            }
            .get(0, 0)
        };
        assert_eq!(read(Component::I8, &[0x80]), -128.0);
        assert_eq!(read(Component::I16, &[0, 0x80]), -32768.0);
        assert_eq!(read(Component::U32, &[0xFF; 4]), 4_294_967_295.0);
        assert_eq!(read(Component::F32, &1.1f32.to_le_bytes()), f64::from(1.1f32));
    }
}
