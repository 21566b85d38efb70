//! A server of a few lines that answers as it is told, and what is fetched from it.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

use super::super::Store;
use super::*;
use crate::geom::VoxelBox;
use crate::input::OpenOptions;

/// How a server treats ranges.
#[derive(Clone, Copy, PartialEq)]
enum Ranges {
    All,
    FromStart,
    None,
}

/// What a server has: bodies by path, and statuses that are answered first.
struct Site {
    objects: HashMap<String, Vec<u8>>,
    statuses: Mutex<HashMap<String, Vec<u16>>>,
    ranges: Ranges,
}

/// Serves `site` until the test's process ends; tells the server's URL.
fn serve(site: Site) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let site = Arc::new(site);
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let site = Arc::clone(&site);
            // A client that goes away in the middle of an answer is none of the test's business.
            std::thread::spawn(move || drop(answer(stream, &site)));
        }
    });
    url
}

fn site(objects: &[(&str, &[u8])], statuses: &[(&str, &[u16])], ranges: Ranges) -> Site {
    let named = |(name, bytes): &(&str, &[u8])| (format!("/{name}"), bytes.to_vec());
    let first = |(name, list): &(&str, &[u16])| (format!("/{name}"), list.to_vec());
    Site {
        objects: objects.iter().map(named).collect(),
        statuses: Mutex::new(statuses.iter().map(first).collect()),
        ranges,
    }
}

fn answer(mut stream: TcpStream, site: &Site) -> io::Result<()> {
    let mut lines = BufReader::new(stream.try_clone()?).lines();
    let first = lines.next().unwrap_or_else(|| Ok(String::new()))?;
    let mut words = first.split(' ');
    let (method, path) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
    let mut range = None;
    for line in lines {
        let line = line?;
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(": ")
            && name.eq_ignore_ascii_case("range")
        {
            range = value.strip_prefix("bytes=").map(str::to_owned);
        }
    }
    let wanted = site
        .statuses
        .lock()
        .unwrap()
        .get_mut(path)
        .and_then(Vec::pop);
    let body = site.objects.get(path);
    let (status, body) = match (wanted, body) {
        (Some(status), _) => (status, Vec::new()),
        (None, None) => (404, b"nothing".to_vec()),
        (None, Some(body)) => part(body, range.as_deref(), site.ranges),
    };
    let len = body.len();
    write!(
        stream,
        "HTTP/1.1 {status} X\r\nContent-Length: {len}\r\nConnection: close\r\n\r\n"
    )?;
    if method != "HEAD" {
        stream.write_all(&body)?;
    }
    Ok(())
}

fn part(body: &[u8], range: Option<&str>, ranges: Ranges) -> (u16, Vec<u8>) {
    let Some((first, last)) = range.and_then(|r| r.split_once('-')) else {
        return (200, body.to_vec());
    };
    let number = |n: &str| n.parse::<usize>().unwrap();
    match ranges {
        Ranges::None => (200, body.to_vec()),
        Ranges::FromStart if first.is_empty() => (400, Vec::new()),
        _ if first.is_empty() => (
            206,
            body[body.len().saturating_sub(number(last))..].to_vec(),
        ),
        _ if number(first) >= body.len() => (416, Vec::new()),
        _ => (
            206,
            body[number(first)..body.len().min(number(last) + 1)].to_vec(),
        ),
    }
}

fn whole(store: &Store, key: &str) -> Result<Option<Vec<u8>>, SourceError> {
    store.whole(key, 10)
}

#[test]
fn whole_objects_and_statuses() {
    let objects: &[(&str, &[u8])] = &[
        ("a/b", b"0123456789"),
        ("long", b"0123456789x"),
        ("later", b"z"),
    ];
    let statuses: &[(&str, &[u16])] = &[
        ("later", &[503, 500]),
        ("never", &[500; 9]),
        ("secret", &[403; 9]),
        ("odd", &[418; 9]),
    ];
    let url = serve(site(objects, statuses, Ranges::All));
    let store = Store::open(&format!("{url}/#part")).unwrap();
    assert_eq!(whole(&store, "a/b").unwrap().unwrap(), b"0123456789");
    assert_eq!(
        whole(&store.below("a").unwrap(), "b").unwrap().unwrap(),
        b"0123456789"
    );
    assert_eq!(whole(&store, "nothing").unwrap(), None, "404");
    assert_eq!(
        whole(&store, "later").unwrap().unwrap(),
        b"z",
        "at the third try"
    );
    for (key, word) in [
        ("never", "500"),
        ("secret", "403"),
        ("odd", "418"),
        ("long", "at most 10"),
    ] {
        let error = whole(&store, key).err().unwrap().to_string();
        assert!(
            error.contains(word) && error.contains(&format!("{url}/{key}")),
            "{error}"
        );
    }
    assert!(!store.was_forbidden());
    assert_eq!(store.metadata("secret").unwrap(), None, "a probe");
    assert!(store.was_forbidden());
}

#[test]
fn parts_of_objects() {
    for ranges in [Ranges::All, Ranges::FromStart] {
        let url = serve(site(&[("a", b"0123456789")], &[], ranges));
        let store = Store::open(&url).unwrap();
        assert_eq!(store.range("a", 2, 3).unwrap().unwrap(), b"234");
        for _ in 0..2 {
            assert_eq!(store.tail("a", 4).unwrap().unwrap(), b"6789");
        }
        assert_eq!(store.tail("b", 4).unwrap(), None, "404");
        for result in [
            store.range("a", 8, 3),
            store.range("a", 80, 3),
            store.tail("a", 11),
        ] {
            assert!(result.is_err(), "beyond the end");
        }
    }
    let url = serve(site(&[("a", b"0123456789")], &[], Ranges::None));
    let store = Store::open(&url).unwrap();
    for result in [store.range("a", 2, 3), store.tail("a", 3)] {
        let error = result.err().unwrap().to_string();
        assert!(error.contains("range requests"), "{error}");
    }
}

#[test]
fn names_queries_and_schemes() {
    let store = Store::open("http://example.org/a b/?key=1#x").unwrap();
    let place = store.below("c d").unwrap().place("0/ü");
    assert_eq!(
        place.to_str(),
        Some("http://example.org/a b/c%20d/0/%C3%BC?key=1")
    );
    assert_eq!(store.name(), "a b");
    for (url, word) in [("ftp://a/b", "ftp://"), ("s3://bucket/a", "s3://")] {
        let error = Store::open(url).err().unwrap().to_string();
        assert!(error.contains(word), "{error}");
    }
    if !cfg!(feature = "remote") {
        let error = Store::open("https://a/b").err().unwrap().to_string();
        assert!(error.contains("--features remote"), "{error}");
    }
    // Port 9 is for discarding: nothing listens there.
    let error = Store::open("http://127.0.0.1:9/").unwrap();
    let error = error.metadata("zarr.json").err().unwrap().to_string();
    assert!(error.contains("tried 3 times"), "{error}");
}

#[test]
fn a_volume_behind_a_url() {
    let metadata = br#"{"zarr_format": 2, "shape": [4, 1, 2], "chunks": [2, 1, 2], "dtype": "|u1", "compressor": null,
        "fill_value": 9, "order": "C", "filters": null}"#;
    let objects: &[(&str, &[u8])] = &[
        ("v.zarr/.zarray", metadata),
        ("v.zarr/1.0.0", &[1, 2, 3, 4]),
    ];
    let url = serve(site(objects, &[("v.zarr/1.0.0", &[503])], Ranges::All));
    let mut source = crate::input::open(&format!("{url}/v.zarr"), &OpenOptions::default()).unwrap();
    assert_eq!(source.desc().name, "v.zarr");
    let whole = VoxelBox::whole(source.desc().dims);
    let mut out = vec![0; 8];
    source.read_box(whole, &mut out).unwrap();
    assert_eq!(out, [9, 9, 9, 9, 1, 2, 3, 4]);
    let error = crate::input::open(&url, &OpenOptions::default());
    let error = error.err().unwrap().to_string();
    assert!(
        error.contains("no metadata") && error.contains(&url),
        "{error}"
    );
}
