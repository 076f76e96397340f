//! Laws, scheme and bookkeeping of the crate, without MPI and files.

mod attraction;
mod bands;
mod bridges;
mod common;
mod deferred_kick;
mod ghosts;
mod hertz;
mod hooke;
mod images;
mod laws;
mod mindlin;
mod mixture;
mod planes;
mod protocols;
mod ranks;
mod registered;
mod shares;
mod sleeping_blocks;
mod sliding;
mod temperatures;
mod tsuji;
mod without_walls;
