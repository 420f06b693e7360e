//! Images: found, checked, and decoded in parallel.

use super::accessors::Accessors;
use super::budget::Budget;
use super::json::{Fault, Json, Parsed, quote};
use super::uri::{self, Target};
use crate::imagefile::{TextureImage, ldr};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};
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

/// A decoded image, or why there is none.
pub(super) type Decoded = std::result::Result<Arc<TextureImage>, String>;

/// All images of the document, also those that no texture shows: a broken one is an error.
pub(super) fn images(
    root: &Json,
    accessors: &Accessors,
    folder: &Path,
    pixels: &mut Budget,
    warnings: &mut Vec<String>,
) -> Parsed<Vec<Decoded>> {
    let mut finder = Finder { accessors, folder, warnings, seen: HashMap::new() };
    let mut encoded = Vec::new();
    for (i, json) in root.entities("images")?.iter().enumerate() {
        encoded.push((json.path().to_owned(), finder.find(i, json)?));
    }
    check_sizes(&encoded, pixels)?;
    let outcomes: Vec<Parsed<Outcome>> =
        encoded.into_par_iter().map(|(path, encoded)| decode(&path, encoded)).collect();
    let mut images: Vec<Decoded> = Vec::with_capacity(outcomes.len());
    for outcome in outcomes {
        images.push(match outcome? {
            Outcome::Decoded(image) => image,
            // The first image of a source stands before those that repeat it.
            Outcome::Again(first) => images[first].clone(),
        });
    }
    Ok(images)
}

/// The media type of an image by its first bytes.
fn recognize(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        Some("image/png")
    } else if bytes.starts_with(b"\xff\xd8\xff") {
        Some("image/jpeg")
    } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
        Some("image/webp")
    } else {
        None
    }
}

/// Where the bytes of an image stand; two images with the same source are one.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Source {
    View(usize),
    File(PathBuf),
}

/// Finds the stored bytes of images.
struct Finder<'f, 'a> {
    accessors: &'f Accessors<'a>,
    folder: &'f Path,
    warnings: &'f mut Vec<String>,
    seen: HashMap<Source, usize>,
}

impl<'f> Finder<'f, '_> {
    fn find(&mut self, index: usize, json: &Json) -> Parsed<Encoded<'f>> {
        let buffers = self.accessors.buffers();
        let view = json.index("bufferView", "bufferViews", buffers.views.len())?;
        let declared = json.string("mimeType")?.map(str::to_owned);
        match (json.string("uri")?, view) {
            (Some(_), Some(_)) | (None, None) => {
                Err(json.fault("must have either a uri or a bufferView, and not both"))
            }
            (None, Some(view)) => {
                if declared.is_none() {
                    return Err(json.missing("mimeType"));
                }
                if buffers.views[view].stride.is_some() {
                    return Err(json.fault_at(
                        "bufferView",
                        "a view of image data must not have a byteStride",
                    ));
                }
                match buffers.bytes(view) {
                    Ok(bytes) => {
                        self.known(index, json, Source::View(view), Cow::Borrowed(bytes), declared)
                    }
                    Err(why) => Ok(Encoded::Unusable(why)),
                }
            }
            (Some(uri), None) => self.external(index, json, uri, declared),
        }
    }

    fn external(
        &mut self,
        index: usize,
        json: &Json,
        uri: &str,
        declared: Option<String>,
    ) -> Parsed<Encoded<'f>> {
        let at = json.path_of("uri");
        match uri::resolve(uri, &at, self.folder)? {
            Target::Data { media_type, bytes } => {
                let picture = media_type.starts_with("image/");
                if !picture && !["", "application/octet-stream"].contains(&media_type.as_str()) {
                    return Err(Fault::new(
                        at,
                        format!("the data URI's type {} is no image's", quote(&media_type)),
                    ));
                }
                self.checked(
                    json,
                    Cow::Owned(bytes),
                    declared.or_else(|| picture.then_some(media_type)),
                    None,
                )
            }
            Target::File(file) => {
                let source = Source::File(file.clone());
                if let Some(first) = self.seen.get(&source) {
                    return Ok(Encoded::Again(*first));
                }
                let bytes = uri::read(&file, &at, LONGEST_IMAGE)?;
                self.known(index, json, source, Cow::Owned(bytes), declared)
            }
            Target::Absolute => {
                let why = format!(
                    "its uri {} is not relative to the scene file, and only such files are read",
                    quote(uri)
                );
                self.warnings.push(format!("{} is not read: {why}", json.path()));
                Ok(Encoded::Unusable(why))
            }
        }
    }

    /// The bytes of a source that another image may have, too.
    fn known(
        &mut self,
        index: usize,
        json: &Json,
        source: Source,
        bytes: Cow<'f, [u8]>,
        declared: Option<String>,
    ) -> Parsed<Encoded<'f>> {
        let file = match &source {
            Source::File(file) => Some(file.clone()),
            Source::View(_) => None,
        };
        let encoded = self.checked(json, bytes, declared, file)?;
        match self.seen.entry(source) {
            Entry::Occupied(first) => Ok(Encoded::Again(*first.get())),
            Entry::Vacant(entry) => {
                entry.insert(index);
                Ok(encoded)
            }
        }
    }

    /// Checks that bytes are what they are declared as.
    fn checked(
        &mut self,
        json: &Json,
        bytes: Cow<'f, [u8]>,
        declared: Option<String>,
        file: Option<PathBuf>,
    ) -> Parsed<Encoded<'f>> {
        match (recognize(&bytes), declared) {
            (Some(actual), Some(declared)) if declared != actual => {
                Err(json.fault(format!("declared as {}, and is {actual}", quote(&declared))))
            }
            (Some(_), _) => Ok(Encoded::Here(bytes, file)),
            (None, Some(declared))
                if ["image/png", "image/jpeg", "image/webp"].contains(&declared.as_str()) =>
            {
                Err(json.fault(format!("declared as {declared}, and is not")))
            }
            (None, _) => {
                let name = file.map_or(String::new(), |f| format!("{} ", f.display()));
                let why = format!("{name}is no PNG, JPEG or WebP image");
                self.warnings.push(format!("{}: {why}", json.path()));
                Ok(Encoded::Unusable(why))
            }
        }
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

/// The image, or what stands for one that cannot be had.
enum Outcome {
    Decoded(Decoded),
    Again(usize),
}

fn decode(path: &str, encoded: Encoded) -> Parsed<Outcome> {
    match encoded {
        Encoded::Unusable(why) => Ok(Outcome::Decoded(Err(why))),
        Encoded::Again(first) => Ok(Outcome::Again(first)),
        Encoded::Here(bytes, file) => match ldr::decode(&bytes) {
            Ok(image) => Ok(Outcome::Decoded(Ok(Arc::new(image)))),
            Err(why) => {
                let name = file.map_or(String::new(), |f| format!("{}: ", f.display()));
                Err(Fault::new(path, format!("{name}{}", why.trim().replace('\n', " "))))
            }
        },
    }
}
