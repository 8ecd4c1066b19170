//! Work on files that is put off until a whole scene has been walked through, and then done in parallel.

use crate::{Error, Result};
use rayon::prelude::*;

/// A part of a scene, or how it is made of a file.
pub(super) enum Pending<T> {
    Ready(T),
    /// Its place among all files of the scene, and the work.
    File(u32, Box<dyn FnOnce() -> Result<T> + Send>),
}

/// An error, and which of the scene's files it is about.
pub(super) type Failure = (u32, Error);

impl<T: Send> Pending<T> {
    pub(super) fn file(place: u32, make: impl FnOnce() -> Result<T> + Send + 'static) -> Pending<T> {
        Pending::File(place, Box::new(make))
    }

    /// The value, made now if it was put off.
    pub(super) fn now(&mut self) -> Result<&T> {
        if let Pending::File(_, make) = self {
            let make = std::mem::replace(make, Box::new(|| Err(Error::Runtime("made already".into()))));
            *self = Pending::Ready(make()?);
        }
        match self {
            Pending::Ready(value) => Ok(value),
            Pending::File(..) => Err(Error::Runtime("still not made".into())),
        }
    }

    /// Does all work. The first failure counts, whatever thread finds it.
    pub(super) fn all(pending: Vec<Pending<T>>) -> Result<Vec<T>, Failure> {
        let make = |pending| match pending {
            Pending::Ready(value) => Ok(value),
            Pending::File(place, make) => make().map_err(|error| (place, error)),
        };
        let made: Vec<Result<T, Failure>> = pending.into_par_iter().map(make).collect();
        made.into_iter().collect()
    }
}

/// The values, or nothing and one more failure.
pub(super) fn unless_failed<T: Default>(made: Result<T, Failure>, failures: &mut Vec<Failure>) -> T {
    made.unwrap_or_else(|failure| {
        failures.push(failure);
        T::default()
    })
}
