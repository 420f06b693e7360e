//! `lumicache completions` and `lumicache man`.

use super::args::Arguments;
use super::terminal::print;
use clap::CommandFactory;
use clap_mangen::Man;
use lumicache::error::{Error, Result};
use std::io::Write;

/// Prints a script that completes the commands in `shell`.
pub fn completions(shell: clap_complete::Shell) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "lumicache", &mut script);
    print(&script)
}

/// Prints the manual page.
pub fn run() -> Result<()> {
    print(&manual().map_err(|e| Error::Device(e.to_string()))?)
}

/// The manual page (roff): the program, then a section for each command with its options.
fn manual() -> std::io::Result<Vec<u8>> {
    let mut program = Arguments::command().disable_help_subcommand(true);
    program.build();
    let mut page = Vec::new();
    let man = Man::new(program.clone());
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    for command in program.get_subcommands() {
        manual_section(command, &mut page)?;
    }
    man.render_version_section(&mut page)?;
    Ok(page)
}

/// Adds the section of `command`, or of each command below it.
fn manual_section(command: &clap::Command, page: &mut Vec<u8>) -> std::io::Result<()> {
    if command.has_subcommands() {
        return command.get_subcommands().try_for_each(|below| manual_section(below, page));
    }
    let title = command.get_bin_name().unwrap_or_else(|| command.get_name()).to_uppercase();
    let man = Man::new(command.clone());
    let mut parts = Vec::new();
    man.render_synopsis_section(&mut parts)?;
    man.render_description_section(&mut parts)?;
    man.render_options_section(&mut parts)?;
    // What is a section of a page of its own is a subsection here.
    let parts = String::from_utf8_lossy(&parts).replace("\n.SH ", "\n.SS ");
    write!(page, ".SH {}\n{parts}", title.replace('-', "\\-"))
}
