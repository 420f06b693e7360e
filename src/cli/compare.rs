//! `lumicache compare`.

use super::args::Compare;
use super::terminal::print_line;
use lumicache::compare::{self, Options};
use lumicache::error::{Error, Result};
use lumicache::fsutil;
use lumicache::imagefile::{check_extension, ldr};

pub fn run(arguments: &Compare) -> Result<()> {
    fsutil::remember_what_is_read();
    if let Some(path) = &arguments.flip {
        check_extension(path, &ldr::EXTENSIONS)?;
        fsutil::check_distinct(
            &[&arguments.image, &arguments.reference],
            std::slice::from_ref(path),
        )?;
        fsutil::check_writable(path)?;
    }
    let options = Options { channel_prefix: arguments.channel_prefix.clone() };
    let comparison = compare::compare_files(&arguments.image, &arguments.reference, &options)?;
    if let Some(path) = &arguments.flip {
        comparison.write_flip_map(path)?;
    }
    if arguments.json {
        return print_line(
            &serde_json::to_string_pretty(&comparison.report)
                .map_err(|e| Error::Device(e.to_string()))?,
        );
    }
    print_line(comparison.report.text().trim_end())
}
