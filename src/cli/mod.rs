//! The command line.

mod args;
mod render;
mod show;
mod terminal;

use args::{Arguments, Bench, Command};
use clap::{CommandFactory, Parser};
use lumicache::error::{Error, Result};
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
        Command::Presets { json } => show::presets(json)?,
        Command::Compare(arguments) => show::compare(&arguments)?,
        Command::Info { scene } => show::info(&scene)?,
        Command::Bench { what: Bench::Accel(arguments) } => show::bench_accel(&arguments)?,
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "lumicache", &mut script);
            show::print(&script)?;
        }
        Command::Man => {
            let mut page = Vec::new();
            clap_mangen::Man::new(Arguments::command()).render(&mut page).map_err(|e| Error::Device(e.to_string()))?;
            show::print(&page)?;
        }
    }
    Ok(Outcome::Done)
}
