//! `--display tev`: shows a picture in tev, an image viewer (Müller, <https://github.com/Tom94/tev>), while it is
//! rendered, by the protocol that tev listens for.

use super::{Talk, heading};
use raybrook::low_level::blocks::Area;
use raybrook::low_level::renderer::PictureBlocks;
use raybrook::low_level::tracer::Finished;
use raybrook::{Error, Result};
use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// How long a viewer may take to answer, and to take pixels, before it is done without.
const PATIENCE: Duration = Duration::from_secs(5);
const CHANNELS: [&str; 3] = ["R", "G", "B"];

#[derive(clap::Args)]
pub struct DisplayArgs {
    /// Show the picture in the viewer tev, while it is rendered: `tev`, or `tev=HOST:PORT`.
    ///
    /// tev must be running; by itself it listens at 127.0.0.1:14158. It is shown linear light without --exposure, as
    /// soon as blocks are finished. The picture is written as always, and also when the viewer is closed meanwhile.
    #[arg(long, value_name = "tev[=HOST:PORT]", help_heading = heading::OUTPUT, hide_short_help = true)]
    display: Option<Address>,
}

/// Where a viewer listens.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Address(String);

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Address, String> {
        let (viewer, address) = text.split_once('=').unwrap_or((text, "127.0.0.1:14158"));
        let port = address.rsplit_once(':').filter(|(host, _)| !host.is_empty()).map(|(_, port)| port.parse::<u16>());
        match (viewer, port) {
            ("tev", Some(Ok(1..))) => Ok(Address(address.to_owned())),
            _ => Err("possible: tev, or tev=HOST:PORT".to_owned()),
        }
    }
}

impl DisplayArgs {
    /// Whether the picture is shown.
    pub fn is_given(&self) -> bool {
        self.display.is_some()
    }

    /// Opens the viewer that is asked for, with an empty picture.
    ///
    /// # Errors
    /// [`Error::Io`] when nothing answers.
    pub fn open(&self, output: &Path, (width, height): (u32, u32), talk: Talk) -> Result<Option<Display>> {
        let Some(Address(address)) = &self.display else { return Ok(None) };
        let name = output.display().to_string();
        let begin = || {
            let mut client = connect(address)?;
            let (image_name, channel_names) = (&*name, &CHANNELS[..]);
            client.send(PacketCreateImage { image_name, grab_focus: true, width, height, channel_names })?;
            Ok(client)
        };
        let client =
            begin().map_err(|error| Error::io("show the picture in tev (is it running?) at", address, error))?;
        Ok(Some(Display { client: Mutex::new(Some(client)), name, talk }))
    }
}

fn connect(address: &str) -> io::Result<TevClient> {
    let mut failure = io::Error::from(io::ErrorKind::AddrNotAvailable);
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(stream) => {
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(TevClient::wrap(stream));
            }
            Err(error) => failure = error,
        }
    }
    Err(failure)
}

/// A viewer that shows a picture.
pub struct Display {
    /// None once it has failed.
    client: Mutex<Option<TevClient>>,
    name: String,
    talk: Talk,
}

impl Display {
    /// Shows blocks that are finished.
    pub fn show(&self, blocks: &PictureBlocks, finished: &Finished) {
        for place in finished.blocks.iter().flat_map(|&number| blocks.places(number)) {
            let rows = place.y.clone().flat_map(|y| finished.film.row(y, place.x.clone()));
            self.put(&place.seen_from(blocks.place()), rows.copied().collect());
        }
    }

    /// Shows a block that an earlier run has finished.
    pub fn show_kept(&self, blocks: &PictureBlocks, number: usize, pixels: &[[f32; 3]]) {
        let mut rest = pixels;
        for place in blocks.places(number) {
            let (now, later) = rest.split_at(place.x.len() * place.y.len());
            self.put(&place.seen_from(blocks.place()), now.to_vec());
            rest = later;
        }
    }

    /// Shows pixels of a place. A viewer that does not take them is done without: the picture is what counts.
    fn put(&self, place: &Area, pixels: Vec<[f32; 3]>) {
        let mut client = self.client.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(open) = client.as_mut().filter(|_| !pixels.is_empty()) else { return };
        let sent = open.send(PacketUpdateImage {
            image_name: &self.name,
            grab_focus: false,
            channel_names: &CHANNELS,
            channel_offsets: &[0, 1, 2],
            channel_strides: &[3; CHANNELS.len()],
            x: place.x.start as u32,
            y: place.y.start as u32,
            width: place.x.len() as u32,
            height: place.y.len() as u32,
            data: pixels.as_flattened(),
        });
        if let Err(error) = sent {
            *client = None;
            if !self.talk.quiet {
                tell!("note: the picture is not shown any more: tev does not take its pixels: {error}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_hosts_and_ports() {
        let address = |text: &str| text.parse::<Address>().map(|Address(address)| address);
        assert_eq!(address("tev").as_deref(), Ok("127.0.0.1:14158"));
        assert_eq!(address("tev=[::1]:99").as_deref(), Ok("[::1]:99"));
        assert_eq!(address("tev=studio:14158").as_deref(), Ok("studio:14158"));
        for wrong in ["", "te", "tev=", "tev=studio", "tev=:1", "tev=studio:0", "tev=studio:65536", "f3d=studio:1"] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
    }
}
