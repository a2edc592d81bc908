//! `render --display tev`: what a viewer is sent, by a viewer that only takes note of it.

use super::{assert_fails, folder, raybrook, stderr};
use std::io::{BufReader, Read};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::thread;

/// Reads little-endian numbers and texts that end with zero, as tev does.
struct Packet<'a>(&'a [u8]);

impl Packet<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (now, rest) = self.0.split_first_chunk().unwrap();
        self.0 = rest;
        *now
    }

    fn number(&mut self) -> usize {
        u32::from_le_bytes(self.take()) as usize
    }

    fn text(&mut self) -> String {
        let end = self.0.iter().position(|&byte| byte == 0).unwrap();
        let text = String::from_utf8(self.0[..end].to_vec()).unwrap();
        self.0 = &self.0[end + 1..];
        text
    }

    fn names(&mut self) -> Vec<String> {
        (0..self.number()).map(|_| self.text()).collect()
    }
}

/// What the viewer shows in the end, and how often each pixel was sent.
#[derive(Default)]
struct Shown {
    name: String,
    size: [usize; 2],
    pixels: Vec<[f32; 3]>,
    sent: Vec<u32>,
    packets: usize,
}

impl Shown {
    fn take(&mut self, packet: &[u8]) {
        const CREATE: u8 = 4;
        const UPDATE: u8 = 6;
        let mut packet = Packet(packet);
        let [kind, grabs_focus] = packet.take();
        let name = packet.text();
        if kind == CREATE {
            self.size = [packet.number(), packet.number()];
            assert_eq!((grabs_focus, packet.names()), (1, ["R", "G", "B"].map(str::to_owned).to_vec()));
            self.pixels = vec![[f32::NAN; 3]; self.size[0] * self.size[1]];
            self.sent = vec![0; self.pixels.len()];
            self.name = name;
            return;
        }
        assert_eq!((kind, grabs_focus, &name), (UPDATE, 0, &self.name));
        assert_eq!(packet.names(), ["R", "G", "B"]);
        let [x, y, width, height] = [(); 4].map(|()| packet.number());
        let places: [u64; 6] = [(); 6].map(|()| u64::from_le_bytes(packet.take()));
        assert_eq!(places, [0, 1, 2, 3, 3, 3], "offsets and strides of the channels");
        for row in y..y + height {
            for at in row * self.size[0] + x..row * self.size[0] + x + width {
                self.pixels[at] = [(); 3].map(|()| f32::from_le_bytes(packet.take()));
                self.sent[at] += 1;
            }
        }
        assert!(packet.0.is_empty());
        self.packets += 1;
    }
}

fn view(stream: TcpStream) -> Shown {
    let (mut stream, mut shown) = (BufReader::new(stream), Shown::default());
    loop {
        let mut length = [0; 4];
        if stream.read_exact(&mut length).is_err() {
            return shown;
        }
        // The length counts itself.
        let mut packet = vec![0; u32::from_le_bytes(length) as usize - 4];
        stream.read_exact(&mut packet).unwrap();
        shown.take(&packet);
    }
}

/// A viewer, and what tells the program of it.
fn viewer() -> (thread::JoinHandle<Shown>, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let option = format!("tev={}", listener.local_addr().unwrap());
    (thread::spawn(move || view(listener.accept().unwrap().0)), option)
}

/// The pixels of a .pfm, top row first.
fn pixels(path: &Path, [width, height]: [usize; 2]) -> Vec<[f32; 3]> {
    let file = std::fs::read(path).unwrap();
    let bytes = &file[file.len() - 12 * width * height..];
    let numbers: Vec<f32> = bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    numbers.as_chunks::<3>().0.chunks(width).rev().flatten().copied().collect()
}

const RENDER: [&str; 5] = ["render", "one.obj", "--device", "reference", "-o"];

#[test]
fn a_viewer_is_sent_each_pixel_of_the_picture_once() {
    let folder = folder();
    let at = folder.path();
    for (more, size) in [
        (&["--samples", "2", "--size", "70x51"][..], [70, 51]),
        (&["--error", "2", "--size", "150x90"], [150, 90]),
        (&["--error", "2", "--size", "150x90", "--crop", "33,20,70x40"], [70, 40]),
        (&["--samples", "2", "--size", "70x51", "--crop", "3,4,50x40", "--keep", "never"], [50, 40]),
    ] {
        let (viewer, display) = viewer();
        let output = raybrook(at, &[&RENDER[..], &["a.pfm", "--display", &display], more].concat());
        assert!(output.status.success() && output.stderr.is_empty(), "{more:?}: {}", stderr(&output));
        let shown = viewer.join().unwrap();
        assert_eq!((&*shown.name, shown.size), ("a.pfm", size), "{more:?}");
        assert!(shown.sent.iter().all(|&sent| sent == 1), "{more:?}");
        let bits = |pixels: &[[f32; 3]]| pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect::<Vec<_>>();
        assert!(bits(&shown.pixels) == bits(&pixels(&at.join("a.pfm"), size)), "{more:?}");
        assert!(shown.packets > 0);
    }
}

#[test]
fn a_viewer_that_is_not_there_is_told_of_and_one_that_goes_costs_nothing() {
    let folder = folder();
    let at = folder.path();
    // Nobody listens at a port that was just given back.
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let nobody = format!("tev={free}");
    let small = ["--size", "16x12", "--samples", "1"];
    let output = raybrook(at, &[&RENDER[..], &["a.pfm", "--display", &nobody], &small].concat());
    assert_fails(&output, 5, &["tev (is it running?)", &free.to_string()]);
    assert!(!at.join("a.pfm").exists());

    let counted = raybrook(at, &[&RENDER[..], &["a.pfm", "--display", "tev", "--counters"], &small].concat());
    assert_fails(&counted, 2, &["--display", "leave out one of both"]);
    let wrong = raybrook(at, &[&RENDER[..], &["a.pfm", "--display", "f3d"], &small].concat());
    assert_fails(&wrong, 2, &["tev=HOST:PORT"]);

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let display = format!("tev={}", listener.local_addr().unwrap());
    let gone = thread::spawn(move || drop(listener.accept().unwrap()));
    let large = ["--size", "900x700", "--samples", "1"];
    let output = raybrook(at, &[&RENDER[..], &["a.pfm", "--display", &display], &large].concat());
    gone.join().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(pixels(&at.join("a.pfm"), [900, 700]).len(), 900 * 700);
    // The system may have taken all of it before the viewer was gone.
    assert!(output.stderr.is_empty() || stderr(&output).starts_with("note: the picture is not shown any more"));
}
