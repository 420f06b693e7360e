//! Enums whose values users write as words.

/// A value of an enum: how it is written, and what it means.
pub struct Word<T> {
    /// How users write it.
    pub word: String,
    /// What it means: the documentation of the variant.
    pub doc: String,
    /// The value.
    pub value: T,
}

/// An enum whose values users write as words.
pub trait Words: Copy + PartialEq + 'static {
    /// All values, in the order of the variants.
    fn words() -> Vec<Word<Self>>;

    /// The word of this value.
    fn word(self) -> String {
        let words = Self::words();
        words.into_iter().find(|w| w.value == self).expect("every value has a word").word
    }

    /// The value written as `word`.
    fn from_word(word: &str) -> Option<Self> {
        Self::words().into_iter().find(|w| w.word == word).map(|w| w.value)
    }
}

/// Defines an enum with a word for each variant. A variant around another such enum has the words
/// of that one behind its own and a hyphen.
macro_rules! words {
    (
        $(#[doc = $doc:literal])+
        pub enum $name:ident {
            $(
                $(#[doc = $about:literal])+
                $variant:ident $(($inner:ident))? = $word:literal,
            )+
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $(
                $(#[doc = $about])+
                $variant $(($inner))?,
            )+
        }

        impl $crate::words::Words for $name {
            fn words() -> Vec<$crate::words::Word<Self>> {
                let lists = [$($crate::words::words!(
                    @ $name::$variant, $word, concat!($($about),+) $(, $inner)?
                )),+];
                lists.into_iter().flatten().collect()
            }
        }

        impl serde::Serialize for $name {
            fn serialize<S: serde::Serializer>(
                &self, serializer: S,
            ) -> std::result::Result<S::Ok, S::Error> {
                serializer.collect_str(&$crate::words::Words::word(*self))
            }
        }

        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(
                from: D,
            ) -> std::result::Result<Self, D::Error> {
                let word = String::deserialize(from)?;
                $crate::words::Words::from_word(&word)
                    .ok_or_else(|| serde::de::Error::custom(format!("there is no word `{word}`")))
            }
        }
    };
    (@ $value:expr, $word:literal, $about:expr) => {
        vec![$crate::words::Word {
            word: $word.to_owned(),
            doc: $about.trim().to_owned(),
            value: $value,
        }]
    };
    (@ $value:expr, $word:literal, $about:expr, $inner:ident) => {
        <$inner as $crate::words::Words>::words()
            .into_iter()
            .map(|inner| $crate::words::Word {
                word: format!("{}-{}", $word, inner.word),
                doc: format!("{} {}", $about.trim(), inner.doc),
                value: $value(inner.value),
            })
            .collect::<Vec<_>>()
    };
}

pub(crate) use words;
