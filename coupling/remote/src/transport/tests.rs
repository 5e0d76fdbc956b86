//! One battery for all channels.

use super::*;
use crate::protocol::{Greeting, Kind, VERSION, numbers_for_text, write_text};
use std::io::{Read, Write};
use std::net::TcpStream;

/// Two ends in this process.
fn pair(address: &Address) -> Result<[Box<dyn Channel>; 2], PeerError> {
    let (mut grains, address) = listen(address, Duration::from_secs(5), &Token::default())?;
    let mut fluid = connect(&address, Duration::from_secs(5))?;
    greet(&mut *fluid, &Token::default())?;
    get(&mut *grains)?;
    Ok([grains, fluid])
}

fn greet(channel: &mut dyn Channel, token: &Token) -> Result<(), PeerError> {
    let text = serde_json::json!(Greeting::new("a test", token)).to_string();
    let length = numbers_for_text(&text);
    let mut payload = channel.loan(length)?;
    write_text(&text, payload.payload_mut());
    channel
        .send(&Header { text: text.len() as u64, length: length as u64, ..Header::new(Kind::Hello) }, payload)
}

fn send(channel: &mut dyn Channel, numbers: &[f64]) -> Result<(), PeerError> {
    let mut payload = channel.loan(numbers.len())?;
    payload.payload_mut().copy_from_slice(numbers);
    let header = Header { length: numbers.len() as u64, run: 7, ..Header::new(Kind::Step) };
    channel.send(&header, payload)
}

fn get(channel: &mut dyn Channel) -> Result<Frame, PeerError> {
    receive(channel, Duration::from_secs(5), || Ok(()))
}

/// Runs a test over shared memory and over TCP.
fn over_both(test: impl Fn([Box<dyn Channel>; 2]) -> Result<(), PeerError>) {
    for address in [Address::unique(), Address::any_port()] {
        pair(&address).and_then(&test).unwrap_or_else(|error| panic!("{address}: {error}"));
    }
}

#[test]
fn frames_of_any_size_go_both_ways() {
    over_both(|[mut grains, mut fluid]| {
        // A hundred times more grains from one step to the next, up and down again.
        for count in [0, 1, 12, 1200, 120_000, 3, 1_200_000, 5_000] {
            let numbers: Vec<f64> = (0..count).map(|i| i as f64 / 7.0).collect();
            send(&mut *fluid, &numbers[..count / 2])?;
            send(&mut *grains, &numbers)?;
            let (there, back) = (get(&mut *fluid)?, get(&mut *grains)?);
            assert!(there.payload() == numbers && back.payload() == &numbers[..count / 2], "{count}");
            assert_eq!((there.kind(), there.header().run), (Kind::Step, 7));
        }
        Ok(())
    });
}

#[test]
fn a_frame_outlives_its_channel_and_changes_threads() {
    over_both(|[mut grains, mut fluid]| {
        send(&mut *grains, &[1.0, 2.0, 3.0])?;
        let frame = get(&mut *fluid)?;
        drop((grains, fluid));
        let sum = std::thread::spawn(move || frame.payload().iter().sum::<f64>()).join();
        assert_eq!(sum.ok(), Some(6.0));
        Ok(())
    });
}

#[test]
fn silence_ends_at_the_time_out_and_heartbeats_put_it_off() {
    over_both(|[mut grains, mut fluid]| {
        send(&mut *fluid, &[])?;
        get(&mut *grains)?;
        let silence = Duration::from_millis(300);
        let start = Instant::now();
        let error = receive(&mut *grains, silence, || Ok(())).err();
        assert!(matches!(error, Some(PeerError::Silent { .. })), "{error:?}");
        assert!(start.elapsed() < 2 * silence, "{:?}", start.elapsed());
        let pulse = fluid.pulse();
        let alive = std::thread::spawn(move || {
            (0..8).for_each(|_| {
                std::thread::sleep(Duration::from_millis(100));
                pulse();
            });
            send(&mut *fluid, &[4.0]).map(|()| fluid)
        });
        let frame = receive(&mut *grains, silence, || Ok(()))?;
        assert_eq!(frame.payload(), [4.0]);
        drop(alive.join());
        Ok(())
    });
}

#[test]
fn an_end_that_is_closed_is_gone() {
    over_both(|[mut grains, mut fluid]| {
        send(&mut *fluid, &[])?;
        get(&mut *grains)?;
        send(&mut *fluid, &[1.0])?;
        drop(fluid);
        assert_eq!(get(&mut *grains)?.payload(), [1.0]);
        assert!(matches!(get(&mut *grains).err(), Some(PeerError::Gone)));
        Ok(())
    });
}

#[test]
fn frames_of_another_version_or_length_are_refused() {
    over_both(|[mut grains, mut fluid]| {
        let payload = grains.loan(2)?;
        grains.send(&Header { version: VERSION + 1, length: 2, ..Header::new(Kind::Step) }, payload)?;
        let error = get(&mut *fluid).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(error.contains("protocol version"), "{error}");
        Ok(())
    });
}

#[test]
fn a_small_shared_memory_is_an_error_before_it_is_full() {
    let Address::Shared(run) = Address::unique() else { return };
    let full = || Some(1 << 20);
    let mut grains = shared::Shared::create(&run).expect("shared memory").with_free(full);
    assert!(grains.loan(100).is_ok());
    let error = grains.loan(100_000).err().expect("too little").to_string();
    assert!(error.contains("1.0 MiB free") && error.contains("help"), "{error}");
}

#[test]
fn a_name_is_for_one_run_only() {
    let Address::Shared(run) = Address::unique() else { return };
    let _first = shared::Shared::create(&run).expect("shared memory");
    let error = shared::Shared::create(&run).err().expect("the name is in use").to_string();
    assert!(error.contains(&run), "{error}");
}

#[test]
fn addresses_read_as_they_are_written() {
    for text in ["shm:my-run_1", "tcp:localhost:4000", "tcp:[::1]:80"] {
        assert_eq!(text.parse::<Address>().map(|address| address.to_string()), Ok(text.to_owned()));
    }
    for text in ["", "shm:", "shm:a/b", "tcp:host", "tcp::1", "tcp:host:99999", "pipe:x"] {
        assert!(text.parse::<Address>().is_err(), "{text}");
    }
}

/// The end of the grains of a run with a token, and the place where it listens.
fn door(token: &Token, silence: Duration) -> Result<(Box<dyn Channel>, Address, String), PeerError> {
    let (grains, address) = listen(&Address::any_port(), silence, token)?;
    let place = address.to_string().trim_start_matches("tcp:").to_owned();
    Ok((grains, address, place))
}

/// The header of a hello that announces so many numbers.
fn announced(numbers: u64) -> Vec<u8> {
    let header = Header { length: numbers, text: 8, ..Header::new(Kind::Hello) };
    // SAFETY: a header has no padding.
    unsafe { std::slice::from_raw_parts((&raw const header).cast::<u8>(), size_of::<Header>()) }.to_vec()
}

#[test]
fn strangers_took_the_place_of_the_solver() -> Result<(), PeerError> {
    let token = Token::random();
    let (mut grains, address, place) = door(&token, Duration::from_secs(5))?;
    let stranger = || TcpStream::connect(&place).expect("it listens");
    let _silent = stranger();
    drop(stranger());
    let say = |bytes: &[u8]| {
        let mut stream = stranger();
        stream.write_all(bytes).expect("it takes a few bytes");
        stream
    };
    let _rest = [
        say(b"GET / HTTP/1.1\r\n\r\n"),
        say(&[0x56; 4000]),
        say(&announced(3)[..60]),
        say(&announced(400_000_000)),
    ];
    let mut guesses = connect(&address, Duration::from_secs(5))?;
    greet(&mut *guesses, &Token::random())?;
    assert!(matches!(grains.poll(LOOK)?, Event::Nothing));
    assert!(grains.turned_away().is_some());
    let mut solver = connect(&address, Duration::from_secs(5))?;
    greet(&mut *solver, &token)?;
    assert_eq!(get(&mut *grains)?.kind(), Kind::Hello);
    send(&mut *grains, &[1.0])?;
    assert_eq!(get(&mut *solver)?.payload(), [1.0]);
    // Nothing of the run has gone to the others, and nobody can come any more.
    assert!(matches!(get(&mut *guesses).err(), Some(PeerError::Gone)));
    let late = TcpStream::connect(&place);
    assert!(late.is_err() || late.is_ok_and(|mut line| line.read(&mut [0]).is_ok_and(|n| n == 0)));
    Ok(())
}

#[test]
fn a_header_alone_took_gigabytes() -> Result<(), PeerError> {
    let (mut grains, address, _) = door(&Token::default(), Duration::from_secs(5))?;
    let mut solver = connect(&address, Duration::from_secs(5))?;
    greet(&mut *solver, &Token::default())?;
    get(&mut *grains)?;
    grains.allow(100);
    send(&mut *solver, &[1.0; 100])?;
    assert_eq!(get(&mut *grains)?.payload().len(), 100);
    send(&mut *solver, &[1.0; 101])?;
    let error = get(&mut *grains).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(error.contains("101 numbers, where at most 100"), "{error}");
    Ok(())
}

#[test]
fn bytes_one_by_one_kept_a_run_waiting() -> Result<(), PeerError> {
    let silence = Duration::from_millis(400);
    let (mut grains, _, place) = door(&Token::default(), silence)?;
    let text = serde_json::json!(Greeting::new("a test", &Token::default())).to_string();
    let length = numbers_for_text(&text);
    let mut bytes = announced(length as u64);
    let at = bytes.len() - 16;
    bytes[at..at + 8].copy_from_slice(&(text.len() as u64).to_le_bytes());
    let mut payload = vec![0.0; length];
    write_text(&text, &mut payload);
    bytes.extend(payload.iter().flat_map(|number| number.to_le_bytes()));
    let mut line = TcpStream::connect(&place).expect("it listens");
    line.write_all(&bytes).expect("it takes a hello");
    get(&mut *grains)?;
    let trickle = std::thread::spawn(move || {
        for byte in announced(1000) {
            std::thread::sleep(Duration::from_millis(20));
            if line.write_all(&[byte]).is_err() {
                return;
            }
        }
    });
    let start = Instant::now();
    let error = receive(&mut *grains, silence, || Ok(())).err().map(|error| error.to_string());
    assert!(error.as_deref().is_some_and(|error| error.contains("not complete after 0.4 s")), "{error:?}");
    assert!(start.elapsed() < 3 * silence, "{:?}", start.elapsed());
    drop(grains);
    trickle.join().expect("no panic");
    Ok(())
}
