//! `lumicache compare`.

use super::args::Compare;
use super::terminal::print_line;
use lumicache::compare::{self, Options};
use lumicache::error::{Error, Result};

pub fn run(arguments: &Compare) -> Result<()> {
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
