//! A render that somebody watches in a viewer, or interrupts.

use crate::support::desk::{Desk, ENDLESS, mean, scene, text};
use lumicache::imagefile::{Attribute, exr};
use nix::sys::signal::Signal;
use serde_json::json;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

/// A viewer: the address to connect to, and the types of the packets of the first connection, as
/// they come.
fn viewer(first: impl FnOnce() + Send + 'static) -> (String, std::thread::JoinHandle<Vec<u8>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let packets = std::thread::spawn(move || {
        let mut stream = listener.accept().unwrap().0;
        let (mut first, mut kinds) = (Some(first), Vec::new());
        while let Some(kind) = packet(&mut stream) {
            kinds.push(kind);
            // Type 6 carries pixels.
            if kind == 6
                && let Some(first) = first.take()
            {
                first();
            }
        }
        kinds
    });
    (address, packets)
}

/// Reads one packet of tev's protocol: its length in bytes, its type, the rest.
fn packet(stream: &mut TcpStream) -> Option<u8> {
    let mut length = [0; 4];
    stream.read_exact(&mut length).ok()?;
    let mut rest = vec![0; u32::from_le_bytes(length) as usize - 4];
    stream.read_exact(&mut rest).unwrap();
    Some(rest[0])
}

#[test]
fn a_viewer_is_sent_every_tile() {
    let desk = Desk::new();
    let (address, packets) = viewer(|| ());
    desk.render("cornell-box", &["--spp", "20", "--display-server", &address]);
    // One packet opens the image; 32 x 24 pixels are four tiles, 20 samples two passes.
    let kinds = packets.join().unwrap();
    assert_eq!((kinds[0], kinds.len()), (4, 1 + 4 * 2), "{kinds:?}");
    assert!(kinds[1..].iter().all(|&k| k == 6), "{kinds:?}");
}

#[test]
fn a_viewer_that_is_not_there_is_told_before_rendering() {
    let desk = Desk::new();
    let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    desk.fail(
        &[&["render", &scene("cornell-box"), "--display-server", &closed], ENDLESS].concat(),
        &[&closed, "cannot connect"],
    );
}

/// What Ctrl-C, a batch system or a closed terminal does.
fn interrupt(child: &Child, signal: Signal) {
    let process = nix::unistd::Pid::from_raw(child.id().try_into().unwrap());
    nix::sys::signal::kill(process, signal).unwrap();
}

/// Runs an endless render of the inside of the box, and interrupts it when its first pixels are
/// there.
fn interrupted(desk: &Desk, more: &[&str]) -> Output {
    let (send, receive) = std::sync::mpsc::channel();
    let (address, packets) = viewer(move || send.send(()).unwrap());
    let room = scene("cornell-box");
    let arguments = [
        &[
            "render",
            &room,
            "-o",
            "out.exr",
            "--crop",
            "160,120,480,360",
            "--display-server",
            &address,
        ],
        ENDLESS,
        more,
    ]
    .concat();
    let child =
        desk.command(&arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    receive.recv_timeout(Duration::from_secs(120)).expect("the render starts");
    interrupt(&child, Signal::SIGINT);
    let output = child.wait_with_output().unwrap();
    packets.join().unwrap();
    output
}

#[test]
fn an_interrupt_keeps_the_picture_so_far() {
    let desk = Desk::new();
    for integrator in ["path", "cache"] {
        let more = [
            "--integrator",
            integrator,
            "--rays",
            "16",
            "--error",
            "1",
            "--set",
            "levels=1",
            "--preview",
            "out.png",
            "--stats",
            "out.json",
        ];
        let output = interrupted(&desk, &more);
        assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
        let (told, error) = (text(&output.stdout), text(&output.stderr));
        assert!(told.starts_with("out.png: exposed by ") && told.lines().count() == 1, "{told}");
        assert_eq!(error, "");
        assert_eq!(desk.files(), ["out.exr", "out.json", "out.png"]);
        let layers = exr::read(&desk.path("out.exr")).unwrap();
        assert_eq!(
            (layers.width, layers.height, layers.attribute("cancelled")),
            (320, 240, Some(&Attribute::Int(1)))
        );
        assert!(
            layers
                .channels
                .iter()
                .all(|c| c.name == "Z" || c.samples.iter().all(|x| x.is_finite()))
        );
        assert!(mean(&layers, "G") > 0.0, "{integrator}: nothing was kept");
        assert_eq!(desk.json("out.json")["cancelled"], json!(true));
    }
}

#[test]
fn an_interrupt_during_the_fill_keeps_the_old_picture_and_the_records_so_far() {
    let desk = Desk::new();
    desk.render("cornell-box", &["--preview", "out.png"]);
    let old = ["out.exr", "out.png"].map(|name| std::fs::read(desk.path(name)).unwrap());
    for signal in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP] {
        let room = scene("indirect-room");
        let arguments = "-o out.exr --preview out.png --stats out.json --cache-save out.lumi \
             --size 640x480 --rays 5000 --error 0.01 --display-server";
        let arguments: Vec<&str> =
            ["render", &room].into_iter().chain(arguments.split_whitespace()).collect();
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let child = desk
            .command(&[&arguments[..], &[&address]].concat())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // The image is opened just before the fill begins.
        let mut stream = listener.accept().unwrap().0;
        assert_eq!(packet(&mut stream), Some(4));
        std::thread::sleep(Duration::from_secs(3));
        interrupt(&child, signal);
        let signalled = Instant::now();
        let output = child.wait_with_output().unwrap();
        let stopped = signalled.elapsed();
        eprintln!("stopped after {stopped:?}");
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(130), "{error}");
        assert!(error.contains("out.exr is as it was") && error.lines().count() == 1, "{error}");
        assert_eq!(["out.exr", "out.png"].map(|n| std::fs::read(desk.path(n)).unwrap()), old);
        assert!(stopped < Duration::from_secs(20), "{stopped:?}");
        let saved = lumicache::cache::CacheFile::read(&desk.path("out.lumi")).unwrap();
        assert!(saved.record_count() > 0);
        assert_eq!(desk.json("out.json")["cancelled"], json!(true));
        std::fs::remove_file(desk.path("out.lumi")).unwrap();
    }
}
