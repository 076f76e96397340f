//! `movie`, on made-up runs.

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use super::fixture::Fixture;
use super::{done, folder_with, refused, text};
use crate::common::reducer;

/// The chunks of a PNG: names and contents.
fn chunks(path: &Path) -> Vec<(String, Vec<u8>)> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    assert_eq!(bytes[..8], *b"\x89PNG\r\n\x1a\n");
    let (mut rest, mut found) = (&bytes[8..], Vec::new());
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        let (name, after) = after.split_at(4);
        found.push((text(name), after[..length].to_vec()));
        rest = &after[length + 4..];
    }
    found
}

fn number(bytes: &[u8]) -> u32 {
    u32::from_be_bytes(bytes[..4].try_into().expect("four bytes"))
}

/// Width, height and pixels (red, green, blue) of a PNG.
fn pixels(path: &Path) -> (u32, u32, Vec<[u8; 3]>) {
    let file = std::fs::File::open(path).expect("a picture");
    let mut decoder = png::Decoder::new(file);
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().expect("a PNG");
    let mut bytes = vec![0; reader.output_buffer_size()];
    let of = reader.next_frame(&mut bytes).expect("pixels");
    (of.width, of.height, bytes.as_chunks().0.to_vec())
}

#[test]
fn a_movie_has_the_frames_that_are_asked_for() {
    let (folder, path) = folder_with(&Fixture::sheared(12, 8, 7));
    let out = folder.path().join("a.png");
    let name = out.to_str().expect("UTF-8");
    let fields = ["--fields", "force,dmin,velocity"];
    let mut arguments = vec!["movie", &path, "--frames", "1..6:2", "--width", "600"];
    arguments.extend(fields);
    arguments.extend(["--rate", "5", "--out", name]);
    let told = done(&arguments);
    assert_eq!(
        told,
        format!("wrote {name}\nwrote {}\n", name.trim_end_matches(".png"))
    );
    let chunks = chunks(&out);
    let of = |kind: &str| -> Vec<&Vec<u8>> {
        chunks
            .iter()
            .filter(|(name, _)| name == kind)
            .map(|(_, of)| of)
            .collect()
    };
    // Three frames, played for ever; each takes 1/5 s.
    assert_eq!((number(of("acTL")[0]), number(&of("acTL")[0][4..])), (3, 0));
    let delays: Vec<&[u8]> = of("fcTL").iter().map(|of| &of[20..24]).collect();
    assert_eq!(delays, [[0, 1, 0, 5]; 3]);
    let [width, height] = [number(of("IHDR")[0]), number(&of("IHDR")[0][4..])];
    assert_eq!((width, height % 2), (600, 0));
    // The series is the same pictures, which change from frame to frame.
    let stills: Vec<_> = (0..3)
        .map(|k| pixels(&folder.path().join(format!("a/{k:05}.png"))))
        .collect();
    assert!(stills.iter().all(|of| (of.0, of.1) == (width, height)));
    assert!(stills[0].2 != stills[1].2 && stills[1].2 != stills[2].2);
    assert_eq!(pixels(&out).2, stills[0].2);
    assert!(!folder.path().join("a/00003.png").exists());
}

/// Two frames of the same grains, one twice as fast: on one scale the slow ones have half of it.
#[test]
fn colours_mean_the_same_in_all_frames() {
    let mut run = Fixture::sheared(12, 8, 3);
    for (frame, speed) in run.frames.iter_mut().zip([1.0, 2.0, 1.0]) {
        for (grain, body) in frame.grains.iter_mut().zip(&run.grains.body) {
            grain.velocity = [if *body == 0 { speed } else { 0.0 }, 0.0, 0.0];
        }
    }
    let (folder, path) = folder_with(&run);
    let out = folder.path().join("a.png");
    done(&[
        "movie",
        &path,
        "--fields",
        "velocity",
        "--out",
        out.to_str().expect("UTF-8"),
    ]);
    // The most frequent colour that is no grey is that of the free grains.
    let colour = |k: usize| {
        let (_, _, pixels) = pixels(&folder.path().join(format!("a/{k:05}.png")));
        let mut counts = std::collections::HashMap::new();
        for pixel in pixels.into_iter().filter(|p| p[0].abs_diff(p[2]) > 30) {
            *counts.entry(pixel).or_insert(0) += 1;
        }
        counts
            .into_iter()
            .max_by_key(|(_, count)| *count)
            .expect("colours")
            .0
    };
    let near = |found: [u8; 3], expected: [u8; 3]| {
        let apart = (0..3).map(|k| found[k].abs_diff(expected[k])).max();
        assert!(apart <= Some(8), "{found:?}, not {expected:?}");
    };
    // Viridis has (33, 145, 140) at the middle of 0 … 2 m/s, and (253, 231, 37) at its end.
    near(colour(0), [33, 145, 140]);
    near(colour(1), [253, 231, 37]);
    near(colour(2), colour(0));
}

/// A stand-in for ffmpeg that keeps its arguments and counts what it reads.
fn with_ffmpeg(folder: &Path, script: &str) -> Command {
    let bin = folder.join("bin");
    std::fs::create_dir_all(&bin).expect("a folder");
    let program = bin.join("ffmpeg");
    std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).expect("written");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("set");
    let mut command = reducer();
    let path = std::env::var("PATH").expect("PATH");
    command.env("PATH", format!("{}:{path}", bin.display()));
    command
}

#[test]
fn ffmpeg_gets_the_pixels_of_every_frame() {
    let (folder, path) = folder_with(&Fixture::sheared(12, 8, 4));
    let script = "for last; do :; done; echo \"$*\" >> \"$last\"; wc -c >> \"$last\"";
    let mut command = with_ffmpeg(folder.path(), script);
    let done = command
        .args(["movie", &path, "--width", "300"])
        .output()
        .expect("it runs");
    assert!(done.status.success(), "{}", text(&done.stderr));
    let movie = std::fs::read_to_string(folder.path().join("movie.mp4")).expect("a movie");
    let (given, bytes) = movie.split_once('\n').expect("two lines");
    let mut words = given.split(' ').skip_while(|word| *word != "-video_size");
    let (width, height) = words
        .nth(1)
        .expect("a size")
        .split_once('x')
        .expect("two sides");
    let [width, height] = [width, height].map(|side| side.parse::<usize>().expect("a number"));
    assert_eq!((width, height % 2), (300, 0));
    assert!(given.contains("-framerate 12 "), "{given}");
    assert_eq!(
        bytes.trim().parse::<usize>().expect("a number"),
        4 * 3 * width * height
    );

    let failing = "cat > /dev/null; echo 'no encoder' >&2; exit 3";
    std::fs::remove_file(folder.path().join("movie.mp4")).expect("removed");
    let mut command = with_ffmpeg(folder.path(), failing);
    let failed = command.args(["movie", &path]).output().expect("it runs");
    let message = text(&failed.stderr);
    assert_eq!(failed.status.code(), Some(1), "{message}");
    assert!(
        message
            .contains("movie.mp4: cannot be written: ffmpeg ended with exit status: 3: no encoder"),
        "{message}"
    );
    assert!(!folder.path().join("movie.mp4").exists());
    crate::common::no_parts(folder.path());
}

#[test]
fn what_makes_no_movie_is_refused() {
    let (folder, path) = folder_with(&Fixture::small());
    let out = folder.path().join("a.gif");
    let out = out.to_str().expect("UTF-8");
    let message = refused(&["movie", &path, "--out", out]);
    assert!(
        message.contains("a.gif: must end in .mp4 (through ffmpeg) or .png"),
        "{message}"
    );
    let message = refused(&["movie", &path, "--frames", "2..6"]);
    assert!(
        message.contains("--frames 2..6: ") && message.contains("has the frames 0 … 5"),
        "{message}"
    );
    for wrong in [
        &["--fields", "colour"][..],
        &["--rate", "0"],
        &["--width", "10"],
    ] {
        let mut arguments = vec!["movie", &path];
        arguments.extend(wrong);
        assert_eq!(
            super::reduce(&arguments).status.code(),
            Some(2),
            "{wrong:?}"
        );
    }
    let mut without = reducer();
    let named = without
        .env("PATH", folder.path())
        .args(["movie", &path, "--out", "a.mp4"]);
    let message = text(&named.output().expect("it runs").stderr);
    assert!(
        message.contains("--out a.mp4: needs ffmpeg, which is not in PATH"),
        "{message}"
    );
    let files = std::fs::read_dir(folder.path()).expect("a folder").count();
    assert_eq!(files, 1, "only run.h5");
}
