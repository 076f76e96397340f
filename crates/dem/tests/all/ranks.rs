//! Ranks of a job that are threads of this process, whose messages may take time.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::sync::{Barrier, Condvar, Mutex};
use std::time::{Duration, Instant};

use bytemuck::{cast_slice, pod_collect_to_vec};
use gshear_dem::domain::{Exchange, HaloMessage};

/// Messages that are under way, by sender and receiver, and when each may be read.
type Queues = Vec<VecDeque<(Instant, Vec<u8>)>>;

/// What the ranks of a job have in common.
pub struct Job {
    size: usize,
    barrier: Barrier,
    /// The present collective messages, by sender and receiver.
    messages: Mutex<Vec<Vec<Vec<u8>>>>,
    /// Halo messages, and terms of sums.
    under_way: [Mutex<Queues>; 2],
    sent: Condvar,
    /// How long a message is under way.
    latency: Duration,
    is_near: bool,
}

/// The channels of [`Job::under_way`].
const HALO: usize = 0;
const TERMS: usize = 1;

impl Job {
    pub fn new(size: usize, latency: Duration) -> Self {
        let channel = || Mutex::new(vec![VecDeque::new(); size * size]);
        Self {
            size,
            barrier: Barrier::new(size),
            messages: Mutex::new(vec![Vec::new(); size]),
            under_way: [channel(), channel()],
            sent: Condvar::new(),
            latency,
            is_near: true,
        }
    }

    /// The same, whose ranks say that messages take long.
    pub fn far(self) -> Self {
        Self {
            is_near: false,
            ..self
        }
    }

    /// Runs `work` on every rank, and returns what it gives on each.
    pub fn run<R: Send>(&self, work: impl Fn(&LocalRank<'_>) -> R + Sync) -> Vec<R> {
        std::thread::scope(|scope| {
            let start = |rank: usize| {
                let work = &work;
                scope.spawn(move || {
                    work(&LocalRank {
                        job: self,
                        rank,
                        is_summing: Cell::default(),
                        meanwhile: Cell::default(),
                        terms: RefCell::default(),
                    })
                })
            };
            let ranks: Vec<_> = (0..self.size).map(start).collect();
            let ends = ranks.into_iter().map(|rank| rank.join().expect("no panic"));
            ends.collect()
        })
    }
}

/// A rank of a job.
pub struct LocalRank<'a> {
    job: &'a Job,
    rank: usize,
    is_summing: Cell<bool>,
    /// Number of halo messages that were sent while a sum was under way.
    meanwhile: Cell<u64>,
    /// Those of the sum under way.
    terms: RefCell<Vec<i64>>,
}

impl LocalRank<'_> {
    /// Number of halo messages that were sent while a sum was under way.
    pub fn sent_during_sums(&self) -> u64 {
        self.meanwhile.get()
    }

    fn post(&self, channel: usize, to: usize, message: Vec<u8>) {
        let ready = Instant::now() + self.job.latency;
        let mut queues = self.job.under_way[channel].lock().expect("no panic");
        queues[self.rank * self.job.size + to].push_back((ready, message));
        self.job.sent.notify_all();
    }

    fn wait(&self, channel: usize, from: usize) -> Vec<u8> {
        let mut queues = self.job.under_way[channel].lock().expect("no panic");
        let (ready, message) = loop {
            match queues[from * self.job.size + self.rank].pop_front() {
                Some(found) => break found,
                // The other channel has its own lock: look again.
                None => {
                    let pause = Duration::from_micros(20);
                    let waited = self.job.sent.wait_timeout(queues, pause);
                    queues = waited.expect("no panic").0;
                }
            }
        };
        drop(queues);
        while Instant::now() < ready {
            std::thread::yield_now();
        }
        message
    }

    fn sums(&self, values: &[i64]) -> Vec<Vec<i64>> {
        let all = self.gather(cast_slice(values));
        all.iter().map(|bytes| pod_collect_to_vec(bytes)).collect()
    }
}

impl Exchange for LocalRank<'_> {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.job.size
    }

    fn is_near(&self) -> bool {
        self.job.is_near
    }

    fn all_to_all(&self, send: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
        self.job.messages.lock().expect("no panic")[self.rank] = send;
        self.job.barrier.wait();
        let messages = self.job.messages.lock().expect("no panic");
        let received = messages.iter().map(|sent| sent[self.rank].clone());
        let received = received.collect();
        drop(messages);
        self.job.barrier.wait();
        received
    }

    fn begin_halo(&self, message: HaloMessage<'_>) {
        let mut numbers = vec![0.0; message.length];
        (message.write)(&mut numbers);
        self.post(HALO, message.rank, cast_slice(&numbers).to_vec());
        let more = u64::from(self.is_summing.get());
        self.meanwhile.set(self.meanwhile.get() + more);
    }

    fn end_halo(&self, rank: usize, read: &mut dyn FnMut(&[f64])) {
        read(&pod_collect_to_vec::<u8, f64>(&self.wait(HALO, rank)));
    }

    fn sum(&self, values: &mut [i64]) {
        let all = self.sums(values);
        for (k, value) in values.iter_mut().enumerate() {
            *value = all.iter().fold(0, |sum, of| sum.wrapping_add(of[k]));
        }
    }

    fn begin_sum(&self, values: &[i64]) {
        assert!(!self.is_summing.replace(true), "one sum at a time");
        *self.terms.borrow_mut() = values.to_vec();
        for to in (0..self.job.size).filter(|to| *to != self.rank) {
            self.post(TERMS, to, cast_slice(values).to_vec());
        }
    }

    fn end_sum(&self, values: &mut [i64]) {
        assert!(self.is_summing.replace(false));
        assert_eq!(values, &self.terms.borrow()[..], "those of the beginning");
        for from in (0..self.job.size).filter(|from| *from != self.rank) {
            let terms: Vec<i64> = pod_collect_to_vec(&self.wait(TERMS, from));
            for (value, term) in values.iter_mut().zip(terms) {
                *value = value.wrapping_add(term);
            }
        }
    }

    fn sum_below(&self, value: u64) -> u64 {
        let all = self.sums(&[value as i64]);
        all[..self.rank].iter().map(|of| of[0] as u64).sum()
    }

    fn maximum(&self, value: f64) -> f64 {
        let all = self.gather(cast_slice(&[value]));
        let values = all
            .iter()
            .map(|bytes| pod_collect_to_vec::<u8, f64>(bytes)[0]);
        values.fold(f64::NEG_INFINITY, f64::max)
    }

    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        self.all_to_all(vec![bytes.to_vec(); self.size()])
    }

    fn broadcast(&self, bytes: Vec<u8>) -> Vec<u8> {
        self.gather(&bytes).swap_remove(0)
    }

    fn barrier(&self) {
        self.job.barrier.wait();
    }
}
