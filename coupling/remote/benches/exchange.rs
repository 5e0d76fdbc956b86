//! Round trips between two processes: 12 columns there, 5 back, for 1e3 to 1e6 grains, over shared memory, TCP, and for
//! comparison a Unix socket. Both ends write every number and read every number.

use criterion::{BenchmarkId, Criterion, Throughput};
use std::env;
use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::process::{Child, Command};
use std::time::Duration;
use voidage_coupling::PeerError;
use voidage_remote::protocol::{Greeting, Header, Kind, numbers_for_text, write_text};
use voidage_remote::token::Token;
use voidage_remote::transport::{self, Address, Channel};

/// Where the other process finds this one.
const PLACE: &str = "VOIDAGE_BENCH_PLACE";
const GRAINS: [usize; 4] = [1_000, 10_000, 100_000, 1_000_000];
const THERE: usize = 12;
const BACK: usize = 5;
const PATIENCE: Duration = Duration::from_secs(30);

fn other(place: &str) -> Child {
    let program = env::current_exe().expect("this program");
    Command::new(program).env(PLACE, place).spawn().expect("another process")
}

fn send(channel: &mut dyn Channel, kind: Kind, numbers: usize) -> Result<(), PeerError> {
    let mut payload = channel.loan(numbers)?;
    payload.payload_mut().fill(1.5);
    channel.send(&Header { length: numbers as u64, ..Header::new(kind) }, payload)
}

fn receive(channel: &mut dyn Channel) -> Result<(Kind, f64, usize), PeerError> {
    let frame = transport::receive(channel, PATIENCE, || Ok(()))?;
    Ok((frame.kind(), frame.payload().iter().sum(), frame.payload().len()))
}

/// The other process: answers until it is told to end.
fn echo(place: &str) -> Result<(), PeerError> {
    let Ok(address) = place.parse::<Address>() else {
        echo_socket(place);
        return Ok(());
    };
    let mut channel = transport::connect(&address, PATIENCE)?;
    let text = serde_json::json!(Greeting::new("a bench", &Token::default())).to_string();
    let length = numbers_for_text(&text);
    let mut payload = channel.loan(length)?;
    write_text(&text, payload.payload_mut());
    channel.send(
        &Header { text: text.len() as u64, length: length as u64, ..Header::new(Kind::Hello) },
        payload,
    )?;
    loop {
        match receive(&mut *channel)? {
            (Kind::Bye, ..) => return Ok(()),
            (_, sum, count) => {
                assert!(sum > 0.0);
                send(&mut *channel, Kind::Solution, count / THERE * BACK)?;
            }
        }
    }
}

fn read(stream: &mut UnixStream, numbers: &mut Vec<f64>) -> bool {
    let mut count = [0; 8];
    if stream.read_exact(&mut count).is_err() {
        return false;
    }
    numbers.resize(usize::from_ne_bytes(count), 0.0);
    stream.read_exact(bytemuck::cast_slice_mut(numbers)).is_ok() && numbers.iter().sum::<f64>() > 0.0
}

fn write(stream: &mut UnixStream, numbers: &mut Vec<f64>, count: usize) {
    numbers.resize(count, 0.0);
    numbers.fill(1.5);
    stream.write_all(&count.to_ne_bytes()).expect("the other end");
    stream.write_all(bytemuck::cast_slice(numbers)).expect("the other end");
}

fn echo_socket(place: &str) {
    let mut stream = UnixStream::connect(place).expect("the other end");
    let mut numbers = Vec::new();
    while read(&mut stream, &mut numbers) {
        let back = numbers.len() / THERE * BACK;
        write(&mut stream, &mut numbers, back);
    }
}

fn round_trips(criterion: &mut Criterion, name: &str, mut trip: impl FnMut(usize)) {
    let mut group = criterion.benchmark_group(name);
    for grains in GRAINS {
        group.throughput(Throughput::Bytes(8 * (grains * (THERE + BACK)) as u64));
        group.bench_function(BenchmarkId::from_parameter(grains), |b| b.iter(|| trip(grains)));
    }
    group.finish();
}

fn over_channel(criterion: &mut Criterion, name: &str, address: &Address) -> Result<(), PeerError> {
    let (mut channel, address) = transport::listen(address, PATIENCE, &Token::default())?;
    let mut child = other(&address.to_string());
    let outcome = ask(criterion, name, &mut *channel);
    child.wait().expect("the other process ends");
    outcome
}

fn ask(criterion: &mut Criterion, name: &str, channel: &mut dyn Channel) -> Result<(), PeerError> {
    receive(channel)?;
    round_trips(criterion, name, |grains| {
        let answer = send(channel, Kind::Step, THERE * grains).and_then(|()| receive(channel));
        assert!(answer.is_ok_and(|(_, sum, count)| sum > 0.0 && count == BACK * grains));
    });
    send(channel, Kind::Bye, 0)
}

fn over_socket(criterion: &mut Criterion) {
    let place = env::temp_dir().join(format!("voidage-bench-{}", std::process::id()));
    let listener = UnixListener::bind(&place).expect("a socket");
    let mut child = other(&place.display().to_string());
    let (mut stream, _) = listener.accept().expect("the other end");
    let mut numbers = Vec::new();
    round_trips(criterion, "unix socket", |grains| {
        write(&mut stream, &mut numbers, THERE * grains);
        assert!(read(&mut stream, &mut numbers) && numbers.len() == BACK * grains);
    });
    drop(stream);
    child.wait().expect("the other process ends");
    std::fs::remove_file(&place).expect("the socket is there");
}

fn main() {
    if let Ok(place) = env::var(PLACE) {
        echo(&place).expect("an orderly end");
        return;
    }
    let mut criterion = Criterion::default().configure_from_args();
    over_channel(&mut criterion, "shared memory", &Address::unique()).expect("shared memory");
    over_channel(&mut criterion, "tcp", &Address::any_port()).expect("tcp");
    over_socket(&mut criterion);
    criterion.final_summary();
}
