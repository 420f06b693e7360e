//! The picture while it is made, in the viewer tev (or anything that speaks its TCP protocol).
//!
//! A viewer is a convenience: when it goes away the render goes on, after one warning.

use crate::error::{Error, Result};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

/// How long to wait for the viewer to accept a connection, and later for it to take a packet.
const PATIENCE: Duration = Duration::from_secs(5);
/// Bytes of samples per packet; a larger tile is sent in bands of rows. The length field limits
/// packets to 4 GiB.
const MAX_PACKET_BYTES: usize = 16 << 20;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// An image in a viewer. Threads may share it.
#[derive(Debug)]
pub struct Display {
    address: String,
    title: String,
    size: [u32; 2],
    channels: Vec<String>,
    /// Where channel `i` begins within a pixel: `i`.
    offsets: Vec<u64>,
    /// From a pixel to the next: the number of channels.
    strides: Vec<u64>,
    /// None once the viewer has gone.
    client: Mutex<Option<TevClient>>,
}

impl Display {
    /// Connects to the viewer at `address` (`host:port`, tev's default is 127.0.0.1:14158) and
    /// opens a black image of `width` x `height` pixels with the channels `channel_names`
    /// there.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] naming the address when nobody answers within five seconds, and
    /// for empty sizes or names that the protocol cannot carry.
    pub fn connect(
        address: &str, title: &str, width: u32, height: u32, channel_names: &[&str],
    ) -> Result<Self> {
        let refused =
            |what: &str| Err(Error::InvalidArgument(format!("display server {address}: {what}")));
        if width == 0 || height == 0 || channel_names.is_empty() {
            return refused(&format!(
                "cannot show {width} x {height} pixels of {} channels",
                channel_names.len()
            ));
        }
        if title.is_empty()
            || channel_names.iter().any(|n| n.is_empty())
            || channel_names.iter().chain([&title]).any(|n| n.contains('\0'))
        {
            return refused("the title and the names of channels must not be empty or contain NUL");
        }
        let mut client = match open(address) {
            Ok(client) => client,
            Err(e) => {
                return refused(&format!(
                    "cannot connect: {e}. Is the viewer running, and listening there?"
                ));
            }
        };
        let create =
            PacketCreateImage { image_name: title, grab_focus: true, width, height, channel_names };
        if let Err(e) = client.send(create) {
            return refused(&format!("cannot open an image: {e}"));
        }
        let count = channel_names.len() as u64;
        Ok(Self {
            address: address.to_owned(),
            title: title.to_owned(),
            size: [width, height],
            channels: channel_names.iter().map(|&n| n.to_owned()).collect(),
            offsets: (0..count).collect(),
            strides: vec![count; channel_names.len()],
            client: Mutex::new(Some(client)),
        })
    }

    /// Shows `data`, the samples of `tile`: pixel by pixel, row by row from the top, all channels
    /// of a pixel together. Empty tiles are ignored.
    ///
    /// Returns a warning when the viewer has just gone away; later calls do nothing.
    ///
    /// # Panics
    /// When `tile` leaves the image or `data` is not its samples.
    #[must_use = "the warning is given only once"]
    pub fn update(&self, tile: Tile, data: &[f32]) -> Option<String> {
        let inside =
            |start: u32, extent: u32, end: u32| start.checked_add(extent).is_some_and(|e| e <= end);
        assert!(
            inside(tile.x, tile.width, self.size[0]) && inside(tile.y, tile.height, self.size[1]),
            "{tile:?} leaves the image"
        );
        let row = tile.width as usize * self.channels.len();
        assert_eq!(data.len(), row * tile.height as usize, "samples of {tile:?}");
        if data.is_empty() {
            return None;
        }
        let rows = (MAX_PACKET_BYTES / (row * size_of::<f32>())).max(1);
        // A thread that panicked while it sent has left at worst half a packet, which the viewer
        // will refuse.
        let mut client = self.client.lock().unwrap_or_else(PoisonError::into_inner);
        let viewer = client.as_mut()?;
        for (band, data) in data.chunks(rows * row).enumerate() {
            let sent = viewer.send(PacketUpdateImage {
                image_name: &self.title,
                grab_focus: false,
                channel_names: &self.channels,
                channel_offsets: &self.offsets,
                channel_strides: &self.strides,
                x: tile.x,
                y: tile.y + (band * rows) as u32,
                width: tile.width,
                height: (data.len() / row) as u32,
                data,
            });
            if let Err(e) = sent {
                *client = None;
                return Some(format!(
                    "display server {}: {e}; the render goes on without it",
                    self.address
                ));
            }
        }
        None
    }

    /// True while the viewer takes what it is sent.
    pub fn is_connected(&self) -> bool {
        self.client.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }

    /// Ends the connection; the viewer keeps the image.
    pub fn finish(self) {
        drop(self);
    }
}

fn open(address: &str) -> std::io::Result<TevClient> {
    let mut last = std::io::Error::new(std::io::ErrorKind::NotFound, "no such host");
    for candidate in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&candidate, PATIENCE) {
            Ok(stream) => {
                stream.set_nodelay(true)?;
                stream.set_write_timeout(Some(PATIENCE))?;
                return Ok(TevClient::wrap(stream));
            }
            Err(e) => last = e,
        }
    }
    Err(last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::net::TcpListener;

    /// A viewer that takes everything, then hands over what it got.
    fn viewer() -> (String, std::thread::JoinHandle<Vec<u8>>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let taken = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            listener.accept().unwrap().0.read_to_end(&mut bytes).unwrap();
            bytes
        });
        (address, taken)
    }

    /// Splits a stream at its length fields and drops them.
    fn packets(mut stream: &[u8]) -> Vec<&[u8]> {
        let mut packets = Vec::new();
        while !stream.is_empty() {
            let length = u32::from_le_bytes(stream[..4].try_into().unwrap()) as usize;
            packets.push(&stream[4..length]);
            stream = &stream[length..];
        }
        packets
    }

    fn le(values: &[u32]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    #[test]
    fn packets_are_framed_as_tev_reads_them() {
        let (address, taken) = viewer();
        let display = Display::connect(&address, "box", 8, 4, &["R", "x.G"]).unwrap();
        let data = [1.0f32, 2.0, 3.0, 4.0];
        assert_eq!(display.update(Tile { x: 6, y: 3, width: 2, height: 1 }, &data), None);
        assert_eq!(display.update(Tile { x: 0, y: 0, width: 0, height: 4 }, &[]), None);
        display.finish();
        let bytes = taken.join().unwrap();
        let packets = packets(&bytes);
        let create = [&[4u8, 1][..], b"box\0", &le(&[8, 4, 2]), b"R\0x.G\0"].concat();
        let samples: Vec<u8> = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        let update = [
            &[6u8, 0][..],
            b"box\0",
            &le(&[2]),
            b"R\0x.G\0",
            &le(&[6, 3, 2, 1]),
            &le(&[0, 0, 1, 0, 2, 0, 2, 0]),
            &samples,
        ]
        .concat();
        assert_eq!(packets, [create, update]);
    }

    #[test]
    fn large_tiles_are_sent_in_bands_that_cover_them() {
        let (address, taken) = viewer();
        let (width, height) = (4096, 1100);
        let display = Display::connect(&address, "t", width, height, &["Y"]).unwrap();
        let data: Vec<f32> = (0..width * height).map(|i| i as f32).collect();
        assert_eq!(display.update(Tile { x: 0, y: 0, width, height }, &data), None);
        drop(display);
        let bytes = taken.join().unwrap();
        let packets = packets(&bytes);
        assert_eq!(packets.len(), 3);
        // After type, focus, "t\0", count and "Y\0" come x, y, width, height.
        let field = |packet: &[u8], i: usize| {
            u32::from_le_bytes(packet[10 + 4 * i..14 + 4 * i].try_into().unwrap())
        };
        assert_eq!([field(packets[1], 1), field(packets[1], 3)], [0, 1024]);
        assert_eq!([field(packets[2], 1), field(packets[2], 3)], [1024, 76]);
        assert!(packets[2].ends_with(&((width * height - 1) as f32).to_le_bytes()));
    }

    #[test]
    fn nobody_there_is_an_error_before_the_render() {
        let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
        let error = Display::connect(&address, "t", 1, 1, &["R"]).unwrap_err().to_string();
        assert!(error.contains(&address) && error.contains("cannot connect"), "{error}");
        assert!(
            Display::connect("no port", "t", 1, 1, &["R"])
                .unwrap_err()
                .to_string()
                .contains("no port")
        );
        assert!(
            Display::connect(&address, "t\0", 1, 1, &["R"])
                .unwrap_err()
                .to_string()
                .contains("NUL")
        );
        assert!(
            Display::connect(&address, "t", 0, 1, &["R"])
                .unwrap_err()
                .to_string()
                .contains("0 x 1")
        );
    }

    #[test]
    fn a_viewer_that_leaves_is_warned_of_once() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let display =
            Display::connect(&listener.local_addr().unwrap().to_string(), "t", 64, 64, &["R"])
                .unwrap();
        drop(listener.accept().unwrap());
        let (tile, data) = (Tile { x: 0, y: 0, width: 64, height: 64 }, vec![0.0; 64 * 64]);
        // The kernel takes some packets before it learns that the other side has closed.
        let warning = (0..1000).find_map(|_| {
            std::thread::sleep(Duration::from_millis(1));
            display.update(tile, &data)
        });
        assert!(warning.unwrap().contains("goes on without it"));
        assert!(!display.is_connected());
        assert_eq!(display.update(tile, &data), None);
    }
}
