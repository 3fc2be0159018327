//! The HTTP API: metadata are read, the destination is set where it differs, and whatever else answers gets one clear
//! sentence.

use crate::encoder::ouster_metadata;
use jink_lidar_driver::ouster::http::set_up;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::mpsc::{Receiver, channel};

/// A web server that answers each request with `answer` of it; the requests come out of the channel.
fn server(answer: impl Fn(&str, usize) -> String + Send + 'static) -> (SocketAddr, Receiver<String>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let (sender, requests) = channel();
    std::thread::spawn(move || {
        for (number, stream) in listener.incoming().enumerate() {
            let mut stream = stream.unwrap();
            let mut text = String::new();
            let mut bytes = [0; 4_096];
            loop {
                let count = stream.read(&mut bytes).unwrap();
                text.push_str(&String::from_utf8_lossy(&bytes[..count]));
                let Some((head, body)) = text.split_once("\r\n\r\n") else {
                    continue;
                };
                let length = head
                    .lines()
                    .find_map(|line| line.strip_prefix("Content-Length: "))
                    .unwrap();
                if body.len() >= length.parse::<usize>().unwrap() {
                    break;
                }
            }
            stream.write_all(answer(&text, number).as_bytes()).unwrap();
            if sender.send(text).is_err() {
                return;
            }
        }
    });
    (address, requests)
}

fn metadata(destination: &str) -> String {
    let body = ouster_metadata(32, 1024, "RNG15_RFL8_NIR8");
    let config =
        format!("{{\"config_params\": {{\"udp_dest\": \"{destination}\", \"udp_port_lidar\": 7502}}, ");
    body.replacen('{', &config, 1)
}

fn ok(body: &str) -> String {
    format!("HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n\r\n{body}")
}

#[test]
fn a_sensor_that_sends_elsewhere_is_made_to_send_here_and_one_that_sends_here_is_left_alone() {
    let (address, requests) = server(|request, _| {
        if request.starts_with("POST") {
            "HTTP/1.1 204 No Content\r\n\r\n".to_owned()
        } else {
            ok(&metadata("169.254.7.7"))
        }
    });
    let found = set_up(address, None, 7502).unwrap();
    assert_eq!(
        (found.rows, found.columns, found.profile.name),
        (32, 1024, "RNG15_RFL8_NIR8")
    );
    let asked: Vec<String> = requests.iter().take(3).collect();
    assert!(asked[0].starts_with("GET /api/v1/sensor/metadata HTTP/1.0\r\n"));
    assert!(
        asked[1].starts_with("POST /api/v1/sensor/config HTTP/1.0\r\n"),
        "{}",
        asked[1]
    );
    assert!(
        asked[1].ends_with("{\"udp_dest\":\"127.0.0.1\",\"udp_port_lidar\":7502}"),
        "{}",
        asked[1]
    );
    assert!(asked[2].starts_with("GET /api/v1/sensor/metadata"));

    let (address, requests) = server(|_, _| ok(&metadata("127.0.0.1")));
    set_up(address, None, 7502).unwrap();
    assert!(requests.iter().take(2).all(|request| request.starts_with("GET")));
}

#[test]
fn whatever_else_answers_gets_one_clear_sentence() {
    for (answer, said) in [
        (
            "HTTP/1.1 404 Not Found\r\n\r\n".to_owned(),
            "refuses /api/v1/sensor/metadata: HTTP/1.1 404 Not Found",
        ),
        (
            "SSH-2.0-OpenSSH_9.2\r\n".to_owned(),
            "answers, and not as a web server",
        ),
        (ok("{}"), "`beam_altitude_angles` is missing"),
        (ok("no json"), "metadata of no use: no JSON object"),
    ] {
        let (address, _requests) = server(move |_, _| answer.clone());
        let error = set_up(address, Some("127.0.0.1".parse().unwrap()), 7502)
            .unwrap_err()
            .to_string();
        assert!(error.contains(said), "{error}");
    }
    let nobody = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))
        .unwrap()
        .local_addr()
        .unwrap();
    let error = set_up(nobody, None, 7502).unwrap_err().to_string();
    assert!(error.contains("does not answer"), "{error}");
}

#[test]
fn an_answer_that_drips_for_ever_is_given_up() {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let drips = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut sent = 0;
        // Until whoever has asked closes the connection.
        while stream.write_all(b"H").is_ok() {
            sent += 1;
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        sent
    });
    let error = set_up(address, None, 7502).unwrap_err().to_string();
    assert!(error.contains("does not answer: timed out"), "{error}");
    assert!(drips.join().unwrap() > 1);
}
