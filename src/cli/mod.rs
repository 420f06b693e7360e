//! The command line: a file for each command.

mod args;
mod tables;
mod terminal;
mod denoiser;
mod presets;
mod bench;
mod cache;
mod compare;
mod info;
mod manual;
mod render;
mod report;

use args::{Arguments, Command};
use clap::Parser;
use lumicache::cache::settings_page;
use lumicache::error::{Error, Result};
use std::process::ExitCode;

/// Parses the arguments and runs the command: 0 done, 1 failed, 2 wrong usage, 130 cancelled.
pub fn main() -> ExitCode {
    terminal::survive_size_limits();
    match run(Arguments::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Error::Cancelled) => ExitCode::from(130),
        Err(error) => {
            terminal::tell(&error.to_string());
            ExitCode::FAILURE
        }
    }
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Render(arguments) => render::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Presets { settings: true, .. } => terminal::print(settings_page().as_bytes()),
        Command::Presets { name, all, json, .. } => presets::run(name.as_deref(), all, json),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Info { scene: Some(scene), input, .. } => info::run(&scene, &input),
        Command::Info { scene: None, .. } => denoiser::info(),
        Command::Cache { what } => cache::run(&what),
        Command::Bench { what } => bench::run(&what),
        Command::Completions { shell } => manual::completions(shell),
        Command::Man => manual::run(),
    }
}
