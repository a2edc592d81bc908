//! `raybrook completions` and `raybrook man`: what packages install, made of the same description as the help.

use super::Cli;
use clap::CommandFactory;
use clap_complete::Shell;
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct CompletionsArgs {
    /// The shell.
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

#[derive(clap::Args)]
pub struct ManArgs {
    /// Folder to write raybrook.1 and one page for each command to; it is made if it is not there.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Prints the completions.
pub fn completions(args: &CompletionsArgs) {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "raybrook", &mut text);
    say!("{}", String::from_utf8_lossy(&text).trim_end());
}

/// Writes the manual pages.
pub fn man(args: &ManArgs) -> Result<()> {
    let create = |e| Error::io("create", &args.folder, e);
    std::fs::create_dir_all(&args.folder).map_err(create)?;
    let mut command = Cli::command();
    command.build();
    page(&args.folder, "raybrook", &command)?;
    let commands = command.get_subcommands().filter(|command| !command.is_hide_set());
    commands.into_iter().try_for_each(|command| {
        let name = format!("raybrook-{}", command.get_name());
        page(&args.folder, &name, &command.clone().name(name.clone()))
    })
}

fn page(folder: &Path, name: &str, command: &clap::Command) -> Result<()> {
    let mut text = Vec::new();
    let path = folder.join(format!("{name}.1"));
    let failed = |e| Error::io("write", &path, e);
    clap_mangen::Man::new(command.clone()).render(&mut text).map_err(failed)?;
    raybrook::low_level::output::write_atomically(&path, |file| std::io::Write::write_all(file, &text))
}
