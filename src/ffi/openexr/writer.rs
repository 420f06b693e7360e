//! The writer, its errors and its encoding pipelines.

use super::data::{Channel, Window};
use super::raw;
use rayon::prelude::*;
use std::cell::Cell;
use std::ffi::{CStr, CString, c_char, c_int};
use std::path::Path;
use std::ptr;

/// What a call of the C core returns: its own message on failure.
pub type Result<T> = std::result::Result<T, String>;

/// Bytes of compressed chunks kept back before they are written; bounds memory, has no influence on
/// the file.
const WAVE_BYTES: usize = 64 << 20;

thread_local! {
    /// The last message of the C core on this thread; its error handler has no user pointer of its
    /// own.
    static LAST_MESSAGE: Cell<Option<String>> = const { Cell::new(None) };
}

/// Keeps the C core's message for [`check`] instead of printing it.
///
/// # Safety
/// `message` is null or a C string, which the C core guarantees.
unsafe extern "C" fn keep_message(
    _: raw::exr_const_context_t, _: raw::exr_result_t, message: *const c_char,
) {
    if !message.is_null() {
        // SAFETY: by contract a C string that lives for this call.
        let text = unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned();
        // During the destruction of a thread the message is lost and `check` falls back to the
        // code's own text.
        let _ = LAST_MESSAGE.try_with(|m| m.set(Some(text)));
    }
}

/// Turns a result code into a `Result`, with the message that came with it.
fn check(code: raw::exr_result_t) -> Result<()> {
    let message = LAST_MESSAGE.take();
    if u32::try_from(code) == Ok(raw::EXR_ERR_SUCCESS) {
        return Ok(());
    }
    Err(message.unwrap_or_else(|| {
        // SAFETY: the function returns a static C string for every code.
        unsafe { CStr::from_ptr(raw::exr_get_default_error_message(code)) }
            .to_string_lossy()
            .into_owned()
    }))
}

fn c_string(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| format!("'{}' contains a NUL character", text.escape_debug()))
}

/// An open file: first its attributes are set, then [`Writer::write`] writes channels and pixels
/// and closes it.
///
/// Dropping it without that leaves an incomplete file behind or removes it, as the C core chooses.
#[derive(Debug)]
pub struct Writer {
    context: raw::exr_context_t,
    part: c_int,
    data_window: Window,
}

// SAFETY: the context is not tied to the thread that made it.
unsafe impl Send for Writer {}
// SAFETY: through `&Writer` only `exr_encoding_*` is called, each with a pipeline of its own;
// openexr_encode.h allows that from several threads on one context at once ("meant to be used by
// separate threads, which can all be accessing the same context concurrently").
unsafe impl Sync for Writer {}

impl Writer {
    /// Creates the file `path`, or truncates it, and sets the standard attributes: scan lines of
    /// increasing y, ZIP compression at zlib's level `zip_level` (0 to 9), square pixels,
    /// `screenWindowCenter` (0, 0), `screenWindowWidth` 1.
    ///
    /// # Errors
    /// The C core's message, when the file cannot be opened or a window is empty.
    pub fn create(
        path: &Path, data_window: Window, display_window: Window, zip_level: u8,
    ) -> Result<Self> {
        use std::os::unix::ffi::OsStrExt;
        if data_window.size().is_none() || display_window.size().is_none() {
            return Err("empty window".to_owned());
        }
        let file = CString::new(path.as_os_str().as_bytes())
            .map_err(|_| "the path contains a NUL character".to_owned())?;
        // SAFETY: integers, floats, null pointers and empty callbacks, for which all-zero bytes are
        // a value.
        let mut options: raw::exr_context_initializer_t = unsafe { std::mem::zeroed() };
        options.size = size_of::<raw::exr_context_initializer_t>();
        options.error_handler_fn = Some(keep_message);
        options.zip_level = c_int::from(zip_level.min(9));
        options.dwa_quality = -1.0;
        let mut context: raw::exr_context_t = ptr::null_mut();
        // SAFETY: all pointers are to live values; the C core copies what it keeps.
        check(unsafe {
            raw::exr_start_write(
                &mut context,
                file.as_ptr(),
                raw::EXR_WRITE_FILE_DIRECTLY,
                &options,
            )
        })?;
        let mut writer = Self { context, part: 0, data_window };
        let (data, display) = (data_window.to_raw(), display_window.to_raw());
        // SAFETY: plain floats, for which all-zero bytes are the value (0, 0).
        let center: raw::exr_attr_v2f_t = unsafe { std::mem::zeroed() };
        // SAFETY: the context is live and in its header stage; a null part name is allowed in a
        // one-part file; the C core copies the windows.
        unsafe {
            check(raw::exr_add_part(
                writer.context,
                ptr::null(),
                raw::EXR_STORAGE_SCANLINE,
                &mut writer.part,
            ))?;
            check(raw::exr_initialize_required_attr(
                writer.context,
                writer.part,
                &display,
                &data,
                1.0,
                &center,
                1.0,
                raw::EXR_LINEORDER_INCREASING_Y,
                raw::EXR_COMPRESSION_ZIP,
            ))?;
        }
        Ok(writer)
    }

    /// Allows names of attributes and channels longer than 31 bytes (up to 255), which old readers
    /// reject.
    ///
    /// # Errors
    /// The C core's message.
    pub fn allow_long_names(&mut self) -> Result<()> {
        // SAFETY: the context is live and in its header stage.
        check(unsafe { raw::exr_set_longname_support(self.context, 1) })
    }

    /// Sets the attribute `name` of type `string`.
    ///
    /// # Errors
    /// The C core's message, as for all `set_` functions: bad name, or a standard attribute of
    /// another type.
    pub fn set_text(&mut self, name: &str, value: &str) -> Result<()> {
        let value = c_string(value)?;
        // SAFETY: as `set` promises; the value is a C string, which is copied.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_string(c, p, n, value.as_ptr()) })
    }

    /// Sets the attribute `name` of type `int`.
    pub fn set_int(&mut self, name: &str, value: i32) -> Result<()> {
        // SAFETY: as `set` promises.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_int(c, p, n, value) })
    }

    /// Sets the attribute `name` of type `float`.
    pub fn set_float(&mut self, name: &str, value: f32) -> Result<()> {
        // SAFETY: as `set` promises.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_float(c, p, n, value) })
    }

    /// Sets the attribute `name` of type `double`.
    pub fn set_double(&mut self, name: &str, value: f64) -> Result<()> {
        // SAFETY: as `set` promises.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_double(c, p, n, value) })
    }

    /// Sets the attribute `name` of type `v2f`.
    pub fn set_v2f(&mut self, name: &str, value: [f32; 2]) -> Result<()> {
        // SAFETY: as `set` promises; `exr_attr_v2f_t` is two floats, so it has the size of the
        // value, and its alignment is at most theirs; the value is copied.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_v2f(c, p, n, value.as_ptr().cast()) })
    }

    /// Sets the attribute `name` of type `v3f`.
    pub fn set_v3f(&mut self, name: &str, value: [f32; 3]) -> Result<()> {
        // SAFETY: `exr_attr_v3f_t` is three floats; as in `set_v2f`.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_v3f(c, p, n, value.as_ptr().cast()) })
    }

    /// Sets the attribute `name` of type `m44f`, its sixteen values in the order of the file.
    pub fn set_m44f(&mut self, name: &str, value: [f32; 16]) -> Result<()> {
        // SAFETY: `exr_attr_m44f_t` is sixteen floats; as in `set_v2f`.
        self.set(name, |c, p, n| unsafe { raw::exr_attr_set_m44f(c, p, n, value.as_ptr().cast()) })
    }

    /// Sets the attribute `name` of type `chromaticities`: x and y of red, green, blue, white.
    pub fn set_chromaticities(&mut self, name: &str, value: [f32; 8]) -> Result<()> {
        // SAFETY: `exr_attr_chromaticities_t` is eight floats; as in `set_v2f`.
        self.set(name, |c, p, n| unsafe {
            raw::exr_attr_set_chromaticities(c, p, n, value.as_ptr().cast())
        })
    }

    /// Calls `set` with the context, which is live and in its header stage, the part, and `name` as
    /// a C string, which is copied.
    fn set(
        &mut self, name: &str,
        set: impl FnOnce(raw::exr_context_t, c_int, *const c_char) -> raw::exr_result_t,
    ) -> Result<()> {
        let name = c_string(name)?;
        check(set(self.context, self.part, name.as_ptr()))
    }

    /// Writes the header and the pixels of `channels`, in any order, and closes the file.
    ///
    /// # Errors
    /// The C core's message: bad or duplicate channel names, a full disk. Sample counts that do not
    /// match the data window.
    pub fn write(mut self, channels: &[Channel<'_>]) -> Result<()> {
        let mut channels = channels.to_vec();
        channels.sort_by(|a, b| a.name.as_bytes().cmp(b.name.as_bytes()));
        self.write_header(&channels)?;
        let chunks = self.chunks()?;
        let chunk_bytes = chunks
            .first()
            .map_or(1, |c| usize::try_from(c.unpacked_size).unwrap_or(usize::MAX))
            .max(1);
        let wave = (WAVE_BYTES / chunk_bytes).max(2 * rayon::current_num_threads());
        for wave in chunks.chunks(wave) {
            let packed = wave
                .par_iter()
                .map(|chunk| self.encode(chunk, &channels))
                .collect::<Result<Vec<_>>>()?;
            for (chunk, bytes) in wave.iter().zip(&packed) {
                // SAFETY: the context is live and in its data stage; pointer and length are those
                // of `bytes`; chunks come in the file's order.
                check(unsafe {
                    raw::exr_write_scanline_chunk(
                        self.context,
                        self.part,
                        chunk.start_y,
                        bytes.as_ptr().cast(),
                        bytes.len() as u64,
                    )
                })?;
            }
        }
        self.close()
    }

    fn write_header(&mut self, channels: &[Channel<'_>]) -> Result<()> {
        let [width, height] = self.data_window.size().ok_or("empty window")?;
        for channel in channels {
            if width.checked_mul(height) != Some(channel.samples.len()) {
                return Err(format!(
                    "channel {}: {} samples for {width} x {height} pixels",
                    channel.name,
                    channel.samples.len()
                ));
            }
            let name = c_string(channel.name)?;
            // SAFETY: the context is live and in its header stage; the name is copied.
            check(unsafe {
                raw::exr_add_channel(
                    self.context,
                    self.part,
                    name.as_ptr(),
                    channel.samples.pixel_type(),
                    raw::EXR_PERCEPTUALLY_LOGARITHMIC,
                    1,
                    1,
                )
            })?;
        }
        // SAFETY: the context is live and in its header stage.
        check(unsafe { raw::exr_write_header(self.context) })
    }

    /// What the C core wants to know of each chunk, in the file's order.
    fn chunks(&mut self) -> Result<Vec<raw::exr_chunk_info_t>> {
        let mut chunks = Vec::new();
        let mut y = self.data_window.min[1];
        loop {
            // SAFETY: plain integers, for which all-zero bytes are a value.
            let mut chunk: raw::exr_chunk_info_t = unsafe { std::mem::zeroed() };
            // SAFETY: the context is live and in its data stage; `chunk` is filled in.
            check(unsafe {
                raw::exr_write_scanline_chunk_info(self.context, self.part, y, &mut chunk)
            })?;
            chunks.push(chunk);
            match y.checked_add(chunk.height.max(1)) {
                Some(next) if next <= self.data_window.max[1] => y = next,
                _ => return Ok(chunks),
            }
        }
    }

    /// Packs and deflates one chunk. `channels` are sorted by name and of checked length.
    fn encode(&self, chunk: &raw::exr_chunk_info_t, channels: &[Channel<'_>]) -> Result<Vec<u8>> {
        let mut pipeline = Pipeline::new(self, chunk)?;
        let infos = pipeline.channels();
        if infos.len() != channels.len() {
            return Err(format!(
                "{} channels in the header, {} given",
                infos.len(),
                channels.len()
            ));
        }
        let [width, _] = self.data_window.size().ok_or("empty window")?;
        let row = usize::try_from(i64::from(chunk.start_y) - i64::from(self.data_window.min[1]))
            .map_err(|e| e.to_string())?;
        for (info, channel) in infos.iter_mut().zip(channels) {
            // SAFETY: the name is a C string of the context, which outlives the pipeline.
            let name = unsafe { CStr::from_ptr(info.channel_name) };
            let size = channel.samples.bytes_per_sample();
            let rows = usize::try_from(info.height).map_err(|e| e.to_string())?;
            let source =
                channel.samples.bytes().get(row * width * size..(row + rows) * width * size);
            let source = source.filter(|_| {
                name.to_bytes() == channel.name.as_bytes()
                    && usize::try_from(info.width) == Ok(width)
            });
            let source = source.ok_or_else(|| {
                format!("channel {}: not the layout the header has", channel.name)
            })?;
            info.user_pixel_stride = if size == 2 { 2 } else { 4 };
            info.user_line_stride =
                i32::try_from(width * size).map_err(|_| "the image is too wide".to_owned())?;
            info.__bindgen_anon_1.encode_from_ptr = source.as_ptr();
        }
        pipeline.run()
    }

    fn close(mut self) -> Result<()> {
        // SAFETY: the context is live; `exr_finish` sets it to null, so that `drop` leaves it
        // alone.
        check(unsafe { raw::exr_finish(&mut self.context) })
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if !self.context.is_null() {
            // SAFETY: the context is live and dropped only here. The result is of no use: writing
            // has failed already.
            unsafe { raw::exr_finish(&mut self.context) };
            LAST_MESSAGE.take();
        }
    }
}

/// An encoding pipeline for one chunk. Boxed, because the C core stores pointers into it.
struct Pipeline<'a> {
    writer: &'a Writer,
    raw: Box<raw::exr_encode_pipeline_t>,
}

impl<'a> Pipeline<'a> {
    fn new(writer: &'a Writer, chunk: &raw::exr_chunk_info_t) -> Result<Self> {
        // SAFETY: all-zero bytes are what EXR_ENCODE_PIPELINE_INITIALIZER is.
        let mut pipeline = Self { writer, raw: Box::new(unsafe { std::mem::zeroed() }) };
        // SAFETY: the context is live and in its data stage, chunk and pipeline are live; after a
        // failure `drop` frees what there is.
        check(unsafe {
            raw::exr_encoding_initialize(writer.context, writer.part, chunk, &mut *pipeline.raw)
        })?;
        Ok(pipeline)
    }

    fn channels(&mut self) -> &mut [raw::exr_coding_channel_info_t] {
        let count = usize::try_from(self.raw.channel_count).unwrap_or(0);
        if count == 0 || self.raw.channels.is_null() {
            return &mut [];
        }
        // SAFETY: after `exr_encoding_initialize` there are `channel_count` initialised entries at
        // `channels`, ours alone.
        unsafe { std::slice::from_raw_parts_mut(self.raw.channels, count) }
    }

    /// Runs the packing and compressing stages and returns the chunk as it goes into the file.
    fn run(mut self) -> Result<Vec<u8>> {
        let (context, part) = (self.writer.context, self.writer.part);
        // SAFETY: context and pipeline are live; `Writer::encode` has set every channel's pointer
        // and strides to memory that outlives this call. Without functions for them, the
        // stages of waiting and writing are left out.
        unsafe {
            check(raw::exr_encoding_choose_default_routines(context, part, &mut *self.raw))?;
            self.raw.yield_until_ready_fn = None;
            self.raw.write_fn = None;
            check(raw::exr_encoding_run(context, part, &mut *self.raw))?;
        }
        // A reader takes a chunk as long as the raw one for raw, so only what deflating made
        // smaller goes into the file deflated. The C core alone (3.1.5) writes it at equal
        // length, too.
        let (start, length) = match (self.raw.compressed_bytes, self.raw.packed_bytes) {
            (deflated, packed) if deflated < packed as usize => {
                (self.raw.compressed_buffer, deflated)
            }
            (_, packed) => (self.raw.packed_buffer, packed as usize),
        };
        if start.is_null() || length == 0 {
            return Err("a chunk came out empty".to_owned());
        }
        // SAFETY: after a successful run the packed pixels lie at `packed_buffer` and what was made
        // of them at `compressed_buffer`, of these lengths.
        Ok(unsafe { std::slice::from_raw_parts(start.cast::<u8>(), length) }.to_vec())
    }
}

impl Drop for Pipeline<'_> {
    fn drop(&mut self) {
        // SAFETY: frees the pipeline's own buffers; all-zero members are left alone.
        unsafe { raw::exr_encoding_destroy(self.writer.context, &mut *self.raw) };
    }
}
