//! What the writer wrote, read back by the C core itself.

use super::data::{Channel, Samples, Window};
use super::raw;
use super::writer::Writer;
use std::ffi::{CStr, CString};
use std::path::Path;

/// The samples of all channels of the file, all of which are 32-bit floats, by name.
fn read_back(path: &Path, [width, height]: [usize; 2]) -> Vec<(String, Vec<f32>)> {
    let file = CString::new(path.to_str().unwrap()).unwrap();
    let ok = |code: raw::exr_result_t| assert_eq!(code, raw::EXR_ERR_SUCCESS as i32, "{path:?}");
    let mut found: Vec<(String, Vec<f32>)> = Vec::new();
    // SAFETY: the calls come in the order that the C core asks for, with live pointers; all-zero
    // bytes are its empty initialisers; each channel is decoded into rows that are ours and large
    // enough.
    unsafe {
        let mut options: raw::exr_context_initializer_t = std::mem::zeroed();
        options.size = size_of::<raw::exr_context_initializer_t>();
        let mut context: raw::exr_context_t = std::ptr::null_mut();
        ok(raw::exr_start_read(&mut context, file.as_ptr(), &options));
        let mut y = 0;
        while y < height as i32 {
            let mut chunk: raw::exr_chunk_info_t = std::mem::zeroed();
            ok(raw::exr_read_scanline_chunk_info(context, 0, y, &mut chunk));
            let mut pipeline: Box<raw::exr_decode_pipeline_t> = Box::new(std::mem::zeroed());
            ok(raw::exr_decoding_initialize(context, 0, &chunk, &mut *pipeline));
            let count = usize::try_from(pipeline.channel_count).unwrap();
            for (k, info) in
                std::slice::from_raw_parts_mut(pipeline.channels, count).iter_mut().enumerate()
            {
                let name = CStr::from_ptr(info.channel_name).to_str().unwrap().to_owned();
                if y == 0 {
                    found.push((name, vec![f32::NAN; width * height]));
                }
                let rows = &mut found[k].1[y as usize * width..];
                assert!(rows.len() >= width * info.height as usize);
                info.user_bytes_per_element = 4;
                info.user_data_type = raw::EXR_PIXEL_FLOAT as u16;
                info.user_pixel_stride = 4;
                info.user_line_stride = 4 * width as i32;
                info.__bindgen_anon_1.decode_to_ptr = rows.as_mut_ptr().cast();
            }
            ok(raw::exr_decoding_choose_default_routines(context, 0, &mut *pipeline));
            ok(raw::exr_decoding_run(context, 0, &mut *pipeline));
            ok(raw::exr_decoding_destroy(context, &mut *pipeline));
            y += chunk.height;
        }
        ok(raw::exr_finish(&mut context));
    }
    found
}

#[test]
fn chunks_that_deflating_does_not_shrink_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut rng = crate::sampling::Rng::new(7);
    let mut as_long_as_raw = 0;
    for size in (1..=5).flat_map(|w| (1..=18).map(move |h| [w, h])) {
        // From noise in all bits to noise in a few: the lengths pass that of the raw chunk.
        for noisy in 0..=16 {
            let [width, height] = size;
            let mut plane = || -> Vec<f32> {
                let count = width * height;
                let value = |k: usize| if k % 16 < noisy { rng.next_f32() - 0.5 } else { 0.25 };
                (0..count).map(value).collect()
            };
            let planes = [("A", plane()), ("N.X", plane()), ("N.Y", plane())];
            let window = Window { min: [0, 0], max: size.map(|n| n as i32 - 1) };
            let channels = planes
                .each_ref()
                .map(|(name, samples)| Channel { name, samples: Samples::Float(samples) });
            Writer::create(&path, window, window, 4).unwrap().write(&channels).unwrap();
            for ((name, samples), (found, back)) in planes.iter().zip(read_back(&path, size)) {
                assert_eq!((*name, samples), (found.as_str(), &back), "{size:?}, {noisy} noisy");
            }
            let bytes = std::fs::read(&path).unwrap();
            let raw: Vec<u8> = planes.iter().flat_map(|p| p.1[0].to_le_bytes()).collect();
            as_long_as_raw += u32::from(size == [1, 1] && bytes.ends_with(&raw));
        }
    }
    assert!(as_long_as_raw > 0, "no chunk was stored raw");
}
