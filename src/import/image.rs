//! Images: found, checked, and decoded in parallel.

use super::budget::Budget;
use super::buffers::Buffers;
use super::document::Document;
use super::fault::{Fault, Parsed, quote};
use super::uri::{self, Target};
use crate::imagefile::{TextureImage, ldr};
use gltf::json::image as json;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;

/// The longest image file that is read.
const LONGEST_IMAGE: u64 = 1 << 30;

/// The stored bytes of an image.
enum Encoded<'a> {
    /// The bytes, and the file they come from where it is not the scene file.
    Here(Cow<'a, [u8]>, Option<PathBuf>),
    /// The same bytes as the image with this index.
    Again(usize),
    /// Not to be had or of no format that we read; an error only if a material shows the image.
    Unusable(String),
}

impl Encoded<'_> {
    fn again(&self) -> Option<usize> {
        if let Self::Again(first) = self { Some(*first) } else { None }
    }
}

/// A decoded image, or why there is none.
pub(super) type Decoded = std::result::Result<Arc<TextureImage>, String>;

/// All images of the document, also those that no texture shows: a broken one is an error.
pub(super) fn images(
    document: &Document, buffers: &Buffers, pixels: &mut Budget, warnings: &mut Vec<String>,
) -> Parsed<Vec<Decoded>> {
    let mut finder = Finder { document, buffers, warnings, seen: HashMap::new() };
    let mut encoded = Vec::new();
    for (i, json) in document.root().images.iter().enumerate() {
        let path = format!("/images/{i}");
        let found = finder.find(i, json, &path)?;
        encoded.push((path, found));
    }
    check_sizes(&encoded, pixels)?;
    let repeats: Vec<(usize, usize)> = encoded
        .iter()
        .enumerate()
        .filter_map(|(i, (_, image))| Some((i, image.again()?)))
        .collect();
    let decoded: Vec<Parsed<Decoded>> =
        encoded.into_par_iter().map(|(path, encoded)| decode(&path, encoded)).collect();
    let mut images = decoded.into_iter().collect::<Parsed<Vec<Decoded>>>()?;
    for (image, first) in repeats {
        images[image] = images[first].clone();
    }
    Ok(images)
}

const KNOWN: [&str; 3] = ["image/png", "image/jpeg", "image/webp"];

/// The media type of an image by its first bytes.
fn recognize(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        Some(KNOWN[0])
    } else if bytes.starts_with(b"\xff\xd8\xff") {
        Some(KNOWN[1])
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        Some(KNOWN[2])
    } else {
        None
    }
}

/// Where the bytes of an image stand; two images with the same source are one.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Source {
    View(usize),
    File(PathBuf),
    /// The data URI of this image.
    Own(usize),
}

/// Finds the stored bytes of images.
struct Finder<'f> {
    document: &'f Document<'f>,
    buffers: &'f Buffers<'f>,
    warnings: &'f mut Vec<String>,
    seen: HashMap<Source, usize>,
}

impl<'f> Finder<'f> {
    fn find(&mut self, index: usize, json: &json::Image, path: &str) -> Parsed<Encoded<'f>> {
        let mut declared = json.mime_type.as_ref().map(|kind| kind.0.clone());
        let (source, bytes) = match (&json.uri, json.buffer_view.map(|view| view.value())) {
            (None, Some(view)) => {
                if declared.is_none() {
                    return Err(Fault::new(path, "the property \"mimeType\" is missing"));
                }
                if self.buffers.views[view].stride().is_some() {
                    let what = "a view of image data must not have a byteStride";
                    return Err(Fault::new(format!("{path}/bufferView"), what));
                }
                match self.buffers.bytes(view) {
                    Ok(bytes) => (Source::View(view), Cow::Borrowed(bytes)),
                    Err(why) => return Ok(Encoded::Unusable(why)),
                }
            }
            (Some(uri), None) => {
                let at = format!("{path}/uri");
                match uri::resolve(uri, &at, self.document.folder)? {
                    Target::Data { media_type, bytes } => {
                        if media_type.starts_with("image/") {
                            declared.get_or_insert(media_type);
                        } else if !["", "application/octet-stream"].contains(&media_type.as_str()) {
                            let what = format!("the data URI's type {media_type:?} is no image's");
                            return Err(Fault::new(at, what));
                        }
                        (Source::Own(index), Cow::Owned(bytes))
                    }
                    Target::File(file) => {
                        let source = Source::File(file.clone());
                        if let Some(first) = self.seen.get(&source) {
                            return Ok(Encoded::Again(*first));
                        }
                        (source, Cow::Owned(uri::read(&file, &at, LONGEST_IMAGE)?))
                    }
                    Target::Absolute => {
                        let why = format!(
                            "its uri {} is not relative to the scene file, and only such files are read",
                            quote(uri)
                        );
                        self.warnings.push(format!("{path} is not read: {why}"));
                        return Ok(Encoded::Unusable(why));
                    }
                }
            }
            _ => {
                let what = "must have either a uri or a bufferView, and not both";
                return Err(Fault::new(path, what));
            }
        };
        let file = match &source {
            Source::File(file) => Some(file.clone()),
            _ => None,
        };
        match (recognize(&bytes), declared) {
            (Some(actual), Some(declared)) if declared != actual => {
                let what = format!("declared as {}, and is {actual}", quote(&declared));
                return Err(Fault::new(path, what));
            }
            (None, Some(declared)) if KNOWN.contains(&declared.as_str()) => {
                return Err(Fault::new(path, format!("declared as {declared}, and is not")));
            }
            (None, _) => {
                let name = file.map_or(String::new(), |f| format!("{} ", f.display()));
                let why = format!("{name}is no PNG, JPEG or WebP image");
                self.warnings.push(format!("{path}: {why}"));
                return Ok(Encoded::Unusable(why));
            }
            _ => {}
        }
        let first = *self.seen.entry(source).or_insert(index);
        Ok(if first == index { Encoded::Here(bytes, file) } else { Encoded::Again(first) })
    }
}

/// Refuses images whose pixels would fill the memory, before they are decoded.
fn check_sizes(images: &[(String, Encoded)], pixels: &mut Budget) -> Parsed<()> {
    for (path, image) in images {
        let Encoded::Here(bytes, _) = image else { continue };
        let reader =
            image::ImageReader::new(std::io::Cursor::new(bytes.as_ref())).with_guessed_format();
        // What cannot be read at all is told with its reason where it is decoded.
        let Some((width, height)) = reader.ok().and_then(|r| r.into_dimensions().ok()) else {
            continue;
        };
        pixels.feed(bytes.len() as u64);
        pixels.spend(u64::from(width) * u64::from(height), 4, path)?;
    }
    Ok(())
}

fn decode(path: &str, encoded: Encoded) -> Parsed<Decoded> {
    let (bytes, file) = match encoded {
        Encoded::Here(bytes, file) => (bytes, file),
        Encoded::Unusable(why) => return Ok(Err(why)),
        Encoded::Again(_) => return Ok(Err(String::new())),
    };
    ldr::decode(&bytes).map(|image| Ok(Arc::new(image))).map_err(|why| {
        let name = file.map_or(String::new(), |f| format!("{}: ", f.display()));
        Fault::new(path, format!("{name}{}", why.trim().replace('\n', " ")))
    })
}
