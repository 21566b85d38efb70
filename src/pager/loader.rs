//! Worker threads that read and decode bricks. No policy: what to load, and in which order, is the pager's to say.

use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;

use crossbeam_channel::{Receiver, Sender, unbounded};

use crate::geom::BrickId;
use crate::store::{BrickData, BrickReader, Store, StoreError};

/// A finished load.
pub type Loaded = (BrickId, Result<BrickData, StoreError>);

/// The threads and the channels to them. Dropping it ends the threads once their current brick is done.
#[derive(Debug)]
pub struct Loader {
    store: Arc<Store>,
    orders: Option<Sender<BrickId>>,
    done: Receiver<Loaded>,
    threads: Vec<JoinHandle<()>>,
    in_flight: usize,
}

impl Loader {
    /// A loader with `threads` threads (at least one).
    ///
    /// # Errors
    /// There is no memory for the decoders.
    pub fn new(store: Arc<Store>, threads: usize) -> io::Result<Self> {
        let (orders, inbox) = unbounded::<BrickId>();
        let (outbox, done) = unbounded();
        let readers: io::Result<Vec<BrickReader>> =
            (0..threads.max(1)).map(|_| BrickReader::new()).collect();
        let threads = readers?
            .into_iter()
            .map(|mut reader| {
                let (store, inbox, outbox) = (Arc::clone(&store), inbox.clone(), outbox.clone());
                std::thread::spawn(move || {
                    for brick in inbox {
                        if outbox
                            .send((brick, store.read_brick(brick, &mut reader)))
                            .is_err()
                        {
                            return;
                        }
                    }
                })
            })
            .collect();
        Ok(Self {
            store,
            orders: Some(orders),
            done,
            threads,
            in_flight: 0,
        })
    }

    /// Bricks ordered and not yet received.
    pub fn in_flight(&self) -> usize {
        self.in_flight
    }

    /// Orders a brick; asks the system to read its record ahead.
    pub fn order(&mut self, brick: BrickId) {
        self.store.advise_will_need(brick);
        if let Some(orders) = &self.orders {
            // The threads live as long as `self.orders`: sending can't fail.
            let _ = orders.send(brick);
            self.in_flight += 1;
        }
    }

    /// The next finished brick; blocks. `None` when nothing is in flight.
    pub fn receive(&mut self) -> Option<Loaded> {
        if self.in_flight == 0 {
            return None;
        }
        let loaded = self.done.recv().ok()?;
        self.in_flight -= 1;
        Some(loaded)
    }
}

impl Drop for Loader {
    fn drop(&mut self) {
        self.orders = None;
        for thread in self.threads.drain(..) {
            // A panic of a worker has been reported by the panic hook.
            let _ = thread.join();
        }
    }
}
