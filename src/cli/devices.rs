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
        println!("{}", devices_json(&list));
    } else {
        print!("{}", devices_report(&list));
    }
    Ok(())
}
