//! Arrays of meshes.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// An array that a mesh owns, or that somebody else keeps for it, unchanged for as long as it is
/// used here.
#[derive(Clone)]
pub struct Buffer<T>(Kept<T>);

#[derive(Clone)]
enum Kept<T> {
    Own(Vec<T>),
    Lent(Arc<dyn AsRef<[T]> + Send + Sync>),
}

impl<T> Buffer<T> {
    /// What `owner` keeps.
    pub fn lent(owner: Arc<dyn AsRef<[T]> + Send + Sync>) -> Self {
        Self(Kept::Lent(owner))
    }

    /// True if somebody else keeps it.
    pub fn is_lent(&self) -> bool {
        matches!(self.0, Kept::Lent(_))
    }
}

impl<T: Clone> Buffer<T> {
    /// The array as its own, copied if it was not.
    pub fn to_mut(&mut self) -> &mut Vec<T> {
        if let Kept::Lent(owner) = &self.0 {
            self.0 = Kept::Own((**owner).as_ref().to_vec());
        }
        match &mut self.0 {
            Kept::Own(array) => array,
            Kept::Lent(_) => unreachable!("it was copied"),
        }
    }
}

impl<T> Deref for Buffer<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Kept::Own(array) => array,
            Kept::Lent(owner) => (**owner).as_ref(),
        }
    }
}

impl<T: Clone> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        self.to_mut()
    }
}

impl<'a, T> IntoIterator for &'a Buffer<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<T> Default for Buffer<T> {
    fn default() -> Self {
        Self(Kept::Own(Vec::new()))
    }
}

impl<T> From<Vec<T>> for Buffer<T> {
    fn from(array: Vec<T>) -> Self {
        Self(Kept::Own(array))
    }
}

impl<T> FromIterator<T> for Buffer<T> {
    fn from_iter<I: IntoIterator<Item = T>>(elements: I) -> Self {
        Self(Kept::Own(elements.into_iter().collect()))
    }
}

impl<T: fmt::Debug> fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}
