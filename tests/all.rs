//! The tests of several crates together: `cargo test -p voidage-tests --test all verification::droplet`.

mod cases {
    mod scenes;
}
mod cost {
    mod builds;
}
mod determinism {
    mod bed;
}
mod remote {
    mod c_solver;
}
mod stability {
    mod heat;
    mod map;
}
mod verification {
    mod balances;
    mod coupling;
    mod droplet;
    mod droplet_choices;
    mod flow;
    mod grains;
    mod hand_over;
    mod leaving;
    mod moving_mesh;
    mod passage;
    mod periodic;
    mod points;
    mod references;
    mod suite;
}
