//! The command line.

mod args;
mod cache;
mod render;
mod report;
mod sequence;
mod show;
mod terminal;

use args::{Arguments, Bench, Command};
use clap::{CommandFactory, Parser};
use clap_mangen::Man;
use lumicache::cache::settings_page;
use lumicache::error::{Error, Result};
use std::io::Write;
use std::process::ExitCode;

/// How a command ended.
enum Outcome {
    Done,
    Cancelled,
}

/// Parses the arguments and runs the command: 0 done, 1 failed, 2 wrong usage, 130 cancelled.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(arguments.command) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Cancelled) => ExitCode::from(130),
        Err(error) => {
            eprintln!("lumicache: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<Outcome> {
    match command {
        Command::Render(arguments) => return render::run(&arguments),
        Command::Report(arguments) => return report::run(&arguments),
        Command::Presets { settings: true, .. } => show::print(settings_page().as_bytes())?,
        Command::Presets { name, all, json, .. } => show::presets(name.as_deref(), all, json)?,
        Command::Compare(arguments) => show::compare(&arguments)?,
        Command::Info { scene } => show::info(&scene)?,
        Command::Cache { what } => cache::run(&what)?,
        Command::Bench { what: Bench::Accel(arguments) } => show::bench_accel(&arguments)?,
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "lumicache", &mut script);
            show::print(&script)?;
        }
        Command::Man => show::print(&manual().map_err(|e| Error::Device(e.to_string()))?)?,
    }
    Ok(Outcome::Done)
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
