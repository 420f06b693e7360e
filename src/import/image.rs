//! Images: found, checked, and decoded in parallel, if something shows them.

use super::budget::Budget;
use super::buffers::Buffers;
use super::document::Document;
use super::fault::{Fault, Parsed, Why, quote};
use super::uri::{self, Target};
use super::warnings::Warnings;
use crate::imagefile::{TextureImage, ldr};
use gltf::json::image as json;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::Arc;

/// The longest image file that is read.
const LONGEST_IMAGE: u64 = 1 << 30;

/// Checks all images of the document, and decodes those that are `wanted`, or all where the caller
/// is strict; `None` for one that cannot be shown, which is mended by leaving it out.
pub(super) fn images(
    document: &Document, buffers: &Buffers, wanted: &BTreeSet<usize>, budget: &mut Budget,
    warnings: &mut Warnings,
) -> Parsed<BTreeMap<usize, Option<Arc<TextureImage>>>> {
    for (i, json) in document.root().images.iter().enumerate() {
        if json.uri.is_some() == json.buffer_view.is_some() {
            let what = "must have either a uri or a bufferView, and not both";
            return Err(Fault::new(format!("/images/{i}"), what));
        }
        let Some(view) = json.buffer_view else { continue };
        if json.mime_type.is_none() {
            warnings.mend(&format!("/images/{i}"), "the property \"mimeType\" is missing")?;
        }
        if buffers.views[view.value()].stride().is_some() {
            let what = "a view of image data should not have a byteStride";
            warnings.mend(&format!("/images/{i}/bufferView"), what)?;
        }
    }
    let unshown = (0..document.root().images.len())
        .filter(|i| warnings.is_strict() && !wanted.contains(i))
        .collect::<Vec<_>>();
    let mut finder = Finder { document, buffers, budget, warnings, seen: HashMap::new() };
    let (mut encoded, mut repeats, mut images) = (Vec::new(), Vec::new(), BTreeMap::new());
    for &i in wanted.iter().chain(&unshown) {
        match finder.find(i, &document.root().images[i]) {
            Ok(Encoded::Here(bytes)) => {
                finder.budget.spend(ldr::memory(&bytes), 1, &format!("/images/{i}"))?;
                encoded.push((i, bytes));
            }
            Ok(Encoded::Again(first)) => repeats.push((i, first)),
            // The specification does not say what else there may be.
            Err(fault) if fault.why == Why::Unsupported && !wanted.contains(&i) => {}
            Err(fault) => drop(images.insert(i, finder.replaced(fault)?)),
        }
    }
    let decoded: Vec<_> =
        encoded.into_par_iter().map(|(i, bytes)| (i, ldr::decode(&bytes))).collect();
    for (i, decoded) in decoded {
        let image = match decoded {
            Ok(image) => Some(Arc::new(image)),
            Err(why) => finder.replaced(Fault::new(format!("/images/{i}"), why))?,
        };
        images.insert(i, image);
    }
    for (i, first) in repeats {
        images.insert(i, images.get(&first).cloned().flatten());
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

/// The stored bytes of an image.
enum Encoded<'a> {
    Here(Cow<'a, [u8]>),
    /// The same bytes as the image with this index.
    Again(usize),
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
    budget: &'f mut Budget,
    warnings: &'f mut Warnings,
    seen: HashMap<Source, usize>,
}

impl<'f> Finder<'f> {
    /// Leaves out an image because of `fault`, if that is harmless.
    fn replaced(&mut self, fault: Fault) -> Parsed<Option<Arc<TextureImage>>> {
        if self.warnings.is_strict() || matches!(fault.why, Why::Forbidden | Why::Memory) {
            return Err(fault);
        }
        let what = "the image cannot be shown, so factors stand alone where materials show it";
        self.warnings.mend(&fault.path, format!("{what}: {}", fault.what))?;
        Ok(None)
    }

    fn find(&mut self, index: usize, json: &json::Image) -> Parsed<Encoded<'f>> {
        let path = format!("/images/{index}");
        let mut declared = json.mime_type.as_ref().map(|kind| kind.0.clone());
        let at = match json.mime_type {
            Some(_) => format!("{path}/mimeType"),
            None => format!("{path}/uri"),
        };
        let (source, bytes) = match (&json.uri, json.buffer_view.map(|view| view.value())) {
            (Some(uri), _) => {
                match uri::resolve(uri, &format!("{path}/uri"), &self.document.folder)? {
                    Target::Data { media_type, bytes } => {
                        if !["", "application/octet-stream"].contains(&media_type.as_str()) {
                            declared.get_or_insert(media_type);
                        }
                        (Source::Own(index), Cow::Owned(bytes))
                    }
                    Target::File(file) => {
                        let source = Source::File(file.clone());
                        if let Some(first) = self.seen.get(&source) {
                            return Ok(Encoded::Again(*first));
                        }
                        let at = format!("{path}/uri");
                        (source, Cow::Owned(uri::read(&file, &at, LONGEST_IMAGE, self.budget)?))
                    }
                    Target::Absolute => {
                        let what = format!("its uri {} names no file", quote(uri));
                        return Err(Fault::new(format!("{path}/uri"), what));
                    }
                }
            }
            (None, view) => {
                let view = view.unwrap_or_default();
                let bytes =
                    self.buffers.bytes(view).map_err(|why| Fault::new(path.as_str(), why))?;
                (Source::View(view), Cow::Borrowed(bytes))
            }
        };
        let actual = recognize(&bytes).ok_or_else(|| {
            let name = match &source {
                Source::File(file) => format!("{} ", quote(&file.to_string_lossy())),
                _ => String::new(),
            };
            Fault::unsupported(path.as_str(), format!("{name}is no PNG, JPEG or WebP image"))
        })?;
        if let Some(declared) = declared.filter(|declared| declared != actual) {
            let what = format!("declared as {}, and is {actual}", quote(&declared));
            self.warnings.mend(&at, what)?;
        }
        let first = *self.seen.entry(source).or_insert(index);
        Ok(if first == index { Encoded::Here(bytes) } else { Encoded::Again(first) })
    }
}
