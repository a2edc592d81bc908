//! `raybrook devices`.

use raybrook::Result;
use raybrook::device::{devices_json, devices_report, list_devices};

#[derive(clap::Args)]
pub struct DevicesArgs {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub fn run(args: &DevicesArgs) -> Result<()> {
    let list = list_devices()?;
    if args.json {
        say!("{}", devices_json(&list));
    } else {
        say!("{}", devices_report(&list).trim_end());
    }
    Ok(())
}
