//! A thread that encodes and writes frames while the next ones are drawn.

use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

use super::{FrameSink, VideoError};

/// Frames on their way to a sink, a few at most: who draws faster than they are written waits.
#[derive(Debug)]
pub struct FrameQueue {
    frames: Option<SyncSender<(u64, Vec<u8>)>>,
    thread: Option<JoinHandle<Result<(), VideoError>>>,
}

impl FrameQueue {
    /// A queue of at most `depth` frames in front of `sink`.
    pub fn new(mut sink: Box<dyn FrameSink>, depth: usize) -> Self {
        let (frames, waiting) = sync_channel::<(u64, Vec<u8>)>(depth);
        let thread = std::thread::spawn(move || {
            let mut is_complete = false;
            for (number, rgba) in waiting {
                // The last message: nothing was forgotten.
                is_complete = number == END;
                if !is_complete {
                    sink.push(number, &rgba)?;
                }
            }
            match is_complete {
                true => sink.finish(),
                false => Ok(()),
            }
        });
        Self {
            frames: Some(frames),
            thread: Some(thread),
        }
    }

    /// Hands on frame `number`, as [`FrameSink::push`]; waits while the queue is full.
    ///
    /// # Errors
    /// An earlier frame could not be written.
    pub fn push(&mut self, number: u64, rgba: Vec<u8>) -> Result<(), VideoError> {
        let sent = self.frames.as_ref().map(|f| f.send((number, rgba)));
        match sent {
            Some(Ok(())) => Ok(()),
            _ => self.end(),
        }
    }

    /// Waits until all is written, and completes the film.
    ///
    /// # Errors
    /// It could not be written.
    pub fn finish(mut self) -> Result<(), VideoError> {
        self.push(END, Vec::new())?;
        self.end()
    }

    fn end(&mut self) -> Result<(), VideoError> {
        self.frames = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) | None => Err(VideoError::Writer),
        }
    }
}

/// The number of no frame: the film is complete.
const END: u64 = u64::MAX;

impl Drop for FrameQueue {
    fn drop(&mut self) {
        // Without the last message the film is given up; what a folder holds stays.
        let _ = self.end();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    #[derive(Default)]
    struct Log(Arc<Mutex<Vec<String>>>);

    impl FrameSink for Log {
        fn push(&mut self, number: u64, rgba: &[u8]) -> Result<(), VideoError> {
            if rgba.is_empty() {
                return Err(VideoError::Transparent("film.mp4".into()));
            }
            self.0.lock().unwrap().push(format!("{number}: {rgba:?}"));
            Ok(())
        }

        fn finish(self: Box<Self>) -> Result<(), VideoError> {
            self.0.lock().unwrap().push("finished".into());
            Ok(())
        }
    }

    fn queue() -> (FrameQueue, Arc<Mutex<Vec<String>>>) {
        let log = Log::default();
        let told = Arc::clone(&log.0);
        (FrameQueue::new(Box::new(log), 1), told)
    }

    #[test]
    fn frames_come_in_their_order_and_then_the_end() {
        let (mut queue, told) = queue();
        for number in 0..3 {
            queue.push(number, vec![number as u8]).unwrap();
        }
        queue.finish().unwrap();
        assert_eq!(
            *told.lock().unwrap(),
            ["0: [0]", "1: [1]", "2: [2]", "finished"]
        );
    }

    #[test]
    fn a_film_that_is_given_up_is_not_finished() {
        let (mut queue, told) = queue();
        queue.push(0, vec![9]).unwrap();
        drop(queue);
        assert_eq!(*told.lock().unwrap(), ["0: [9]"]);
    }

    #[test]
    fn an_error_reaches_who_draws() {
        let (mut queue, told) = queue();
        queue.push(0, Vec::new()).unwrap();
        let error = (1..1000).find_map(|n| queue.push(n, vec![1]).err());
        assert!(
            matches!(error, Some(VideoError::Transparent(_))),
            "{error:?}"
        );
        assert!(queue.finish().is_err(), "and stays one");
        assert!(told.lock().unwrap().is_empty(), "nothing was finished");
    }
}
