//! Worker threads that read and decode bricks. No policy: what to load, and in which order, is the pager's to say.
//!
//! Orders wait in a queue of their own instead of a channel, since those that no thread has taken yet can be taken back.

use std::collections::VecDeque;
use std::fmt;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, unbounded};

use crate::geom::BrickId;
use crate::store::{BrickData, BrickReader, Store, StoreError};

/// A finished load.
pub type Loaded = (BrickId, Result<BrickData, StoreError>);

/// Called on the worker thread before a brick is read; an error takes the place of the read. For tests: delays, any
/// order of arrival, failures.
pub type ReadHook = Arc<dyn Fn(BrickId) -> Result<(), StoreError> + Send + Sync>;

/// Orders that no thread has taken yet, in their order.
#[derive(Debug, Default)]
struct Orders {
    waiting: VecDeque<BrickId>,
    is_closed: bool,
}

#[derive(Debug, Default)]
struct OrderQueue {
    orders: Mutex<Orders>,
    changed: Condvar,
}

impl OrderQueue {
    /// No thread panics while it holds the lock, so a poisoned one is as good as any.
    fn lock(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The next order; waits for one. `None`: there will be no more.
    fn take(&self) -> Option<BrickId> {
        let mut orders = self.lock();
        loop {
            if orders.is_closed {
                return None;
            }
            if let Some(brick) = orders.waiting.pop_front() {
                return Some(brick);
            }
            orders = self
                .changed
                .wait(orders)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// The threads and the ways to them. Dropping it ends the threads once their current brick is done.
pub struct Loader {
    store: Arc<Store>,
    queue: Arc<OrderQueue>,
    done: Receiver<Loaded>,
    threads: Vec<JoinHandle<()>>,
    in_flight: usize,
}

impl fmt::Debug for Loader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Loader")
            .field("store", &self.store.path())
            .field("threads", &self.threads.len())
            .field("in_flight", &self.in_flight)
            .finish_non_exhaustive()
    }
}

impl Loader {
    /// A loader with `threads` threads (at least one).
    ///
    /// # Errors
    /// There is no memory for the decoders, or the system gives no thread.
    pub fn new(store: Arc<Store>, threads: usize) -> io::Result<Self> {
        Self::with_hook(store, threads, Arc::new(|_| Ok(())))
    }

    /// As [`Self::new`], with a hook before each read.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_hook(store: Arc<Store>, threads: usize, hook: ReadHook) -> io::Result<Self> {
        let (outbox, done) = unbounded();
        // From here on, dropping it ends the threads that were started.
        let mut loader = Self {
            store,
            queue: Arc::default(),
            done,
            threads: Vec::new(),
            in_flight: 0,
        };
        for number in 0..threads.max(1) {
            let mut reader = BrickReader::new()?;
            let (store, queue) = (Arc::clone(&loader.store), Arc::clone(&loader.queue));
            let (outbox, hook) = (outbox.clone(), Arc::clone(&hook));
            let work = move || {
                while let Some(brick) = queue.take() {
                    let result = hook(brick).and_then(|()| store.read_brick(brick, &mut reader));
                    if outbox.send((brick, result)).is_err() {
                        return;
                    }
                }
            };
            let name = format!("pager.loader {number}");
            let thread = std::thread::Builder::new().name(name).spawn(work)?;
            loader.threads.push(thread);
        }
        Ok(loader)
    }

    /// Bricks ordered and neither received nor cancelled.
    pub fn in_flight(&self) -> usize {
        self.in_flight
    }

    /// Orders a brick; asks the system to read its record ahead.
    pub fn order(&mut self, brick: BrickId) {
        self.order_all(&[brick]);
    }

    /// Orders bricks, to be read in this order; asks the system to read their records ahead, neighbours in the file in
    /// one go.
    pub fn order_all(&mut self, bricks: &[BrickId]) {
        self.store.advise_will_need(bricks);
        self.in_flight += bricks.len();
        self.queue.lock().waiting.extend(bricks);
        self.queue.changed.notify_all();
    }

    /// Takes back an order; `false` when there is none, or a thread has it already: then the brick will be received.
    pub fn cancel(&mut self, brick: BrickId) -> bool {
        let waiting = &mut self.queue.lock().waiting;
        let place = waiting.iter().position(|b| *b == brick);
        if let Some(place) = place {
            waiting.remove(place);
            self.in_flight -= 1;
        }
        place.is_some()
    }

    /// The next finished brick; blocks. `None` when nothing is in flight, or no thread is left (all panicked).
    pub fn receive(&mut self) -> Option<Loaded> {
        if self.in_flight == 0 {
            return None;
        }
        let loaded = self.done.recv().ok()?;
        self.in_flight -= 1;
        Some(loaded)
    }

    /// The next finished brick, if one comes within `timeout`. Returns at once when nothing is in flight.
    pub fn receive_timeout(&mut self, timeout: Duration) -> Option<Loaded> {
        if self.in_flight == 0 {
            return None;
        }
        let loaded = self.done.recv_timeout(timeout).ok()?;
        self.in_flight -= 1;
        Some(loaded)
    }

    /// A finished brick, if there is one; does not block.
    pub fn try_receive(&mut self) -> Option<Loaded> {
        let loaded = self.done.try_recv().ok()?;
        self.in_flight -= 1;
        Some(loaded)
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.queue.lock().is_closed = true;
        self.queue.changed.notify_all();
        for thread in self.threads.drain(..) {
            // A panic of a worker has been reported by the panic hook.
            let _ = thread.join();
        }
    }
}
