//! What the pages and the worker share: who looks, from where, and what is there to show.
//!
//! The worker takes the next job, the pages take the newest picture. Nothing is queued: a page that is slow misses
//! pictures, and a camera that moves makes what is on its way worthless, so that it is stopped.

use super::facts::{AskedMethod, Layer, SceneFacts, Shown};
use super::navigator::Move;
use super::pick::Pickable;
use super::session::{News, Session};
use raybrook::Camera;
use raybrook::low_level::film::Film;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long a page waits for news before it asks again.
pub const PATIENCE: Duration = Duration::from_secs(2);
/// How often pages that are asleep are looked for.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// The number of the first page.
const FIRST_SESSION: u64 = 1;
/// Pages that are open at a time; of more those that asked least recently are forgotten.
const MOST_SESSIONS: usize = 64;

/// A picture to make.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    session: u64,
    generation: u64,
    /// Which step of refinement it is; 0 is coarse.
    pub step: usize,
    /// How coarse the coarse picture was: pixels of a side for a ray.
    pub divisor: u32,
    /// Where from.
    pub camera: Camera,
    /// What of.
    pub layer: Layer,
}

/// What the worker is to do.
#[derive(Debug, PartialEq)]
pub enum Task {
    /// Make a picture.
    Draw(Job),
    /// Trace by another method.
    Switch(AskedMethod),
    /// Read the scene's files again.
    Reload,
}

struct State {
    sessions: BTreeMap<u64, Session>,
    next_session: u64,
    first_camera: Camera,
    diagonal: f64,
    facts: SceneFacts,
    asked: Option<AskedMethod>,
    must_reload: bool,
    pickable: Option<Arc<Pickable>>,
    /// The picture that is being made.
    current: Option<Job>,
    last_served: u64,
}

/// What the pages and the worker share.
pub struct Hub {
    state: Mutex<State>,
    changed: Condvar,
    /// Stops what the worker's tracers do.
    pub stop: Arc<AtomicBool>,
}

impl Hub {
    /// For a scene of that diagonal, which is first seen by `camera`.
    pub fn new(camera: Camera, diagonal: f64, facts: SceneFacts) -> Hub {
        let state = State {
            sessions: BTreeMap::new(),
            next_session: FIRST_SESSION,
            first_camera: camera,
            diagonal,
            facts,
            asked: None,
            must_reload: false,
            pickable: None,
            current: None,
            last_served: 0,
        };
        Hub { state: Mutex::new(state), changed: Condvar::new(), stop: Arc::default() }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins a page, and returns its number.
    pub fn begin(&self) -> u64 {
        let mut state = self.lock();
        if state.sessions.len() >= MOST_SESSIONS {
            let oldest = state.sessions.iter().min_by_key(|(_, session)| session.asked).map(|(&id, _)| id);
            oldest.and_then(|id| state.sessions.remove(&id));
        }
        let id = state.next_session;
        state.next_session += 1;
        let session = Session::new(state.first_camera, state.diagonal);
        state.sessions.insert(id, session);
        self.stop_finer_work(&state);
        self.changed.notify_all();
        id
    }

    /// Waits until a page has begun, but no longer than that.
    pub fn wait_for_page(&self, most: Duration) {
        let is_none = |state: &mut State| state.next_session == FIRST_SESSION;
        drop(self.changed.wait_timeout_while(self.lock(), most, is_none));
    }

    /// Ends a page: what is made for it is stopped.
    pub fn end(&self, id: u64) {
        let mut state = self.lock();
        state.sessions.remove(&id);
        if state.current.as_ref().is_some_and(|job| job.session == id) {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.changed.notify_all();
    }

    /// Does something to a page; `None` where there is no such page.
    fn with<T>(&self, id: u64, work: impl FnOnce(&mut Session) -> T) -> Option<T> {
        let mut state = self.lock();
        let session = state.sessions.get_mut(&id)?;
        session.asked = Instant::now();
        let generation = session.generation;
        let done = work(session);
        if session.generation != generation {
            self.stop_finer_work(&state);
        }
        self.changed.notify_all();
        Some(done)
    }

    /// Moves a page's camera.
    pub fn apply(&self, id: u64, moves: &[Move]) -> Option<()> {
        self.with(id, |session| {
            let before = session.navigator.camera();
            moves.iter().for_each(|&by| session.navigator.apply(by));
            if session.navigator.camera() != before {
                session.begin_anew();
            }
        })
    }

    /// Has a page show something else.
    pub fn set_layer(&self, id: u64, layer: Layer) -> Option<()> {
        self.with(id, |session| {
            if session.layer != layer {
                session.layer = layer;
                session.begin_anew();
            }
        })
    }

    /// Makes a page's picture lighter by so many stops.
    pub fn set_exposure(&self, id: u64, stops: f32) -> Option<()> {
        self.with(id, |session| {
            session.exposure = stops;
            session.frame += 1;
            session.version += 1;
        })
    }

    /// Where a page's camera is.
    pub fn camera(&self, id: u64) -> Option<Camera> {
        self.with(id, |session| session.navigator.camera())
    }

    /// The finished picture of a page, and its exposure. `None` where there is no such page, `Some(None)` where the
    /// picture is not finished.
    pub fn finished(&self, id: u64) -> Option<Option<(Arc<Film>, f32)>> {
        let mut state = self.lock();
        let State { sessions, facts, .. } = &mut *state;
        let session = sessions.get_mut(&id)?;
        session.asked = Instant::now();
        let shown = session.shown.as_ref().filter(|_| session.is_finished(facts));
        Some(shown.map(|shown| (shown.film.clone(), session.exposure)))
    }

    /// What tells what is under the pointer, once the scene is built.
    pub fn pickable(&self) -> Option<Arc<Pickable>> {
        self.lock().pickable.clone()
    }

    /// Asks for another method.
    pub fn ask_method(&self, asked: AskedMethod) {
        let mut state = self.lock();
        state.asked = Some(asked);
        self.stop_finer_work(&state);
        self.changed.notify_all();
    }

    /// Asks for the scene's files to be read again.
    pub fn ask_reload(&self) {
        let mut state = self.lock();
        state.must_reload = true;
        self.stop_finer_work(&state);
        self.changed.notify_all();
    }

    /// Stops what is being made, unless it is coarse: a camera that goes on moving is to be followed by pictures.
    fn stop_finer_work(&self, state: &State) {
        if state.current.as_ref().is_some_and(|job| job.step > 0) {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    /// Waits for news of a page that knows `version`, and has the picture number `frame`. `None` where there is no such
    /// page, `Some(None)` where there is no news for a while.
    pub fn news(&self, id: u64, version: u64, frame: u64) -> Option<Option<News>> {
        let deadline = Instant::now() + PATIENCE;
        let mut state = self.lock();
        loop {
            let State { sessions, facts, .. } = &mut *state;
            let session = sessions.get_mut(&id)?;
            if session.is_asleep() {
                self.changed.notify_all();
            }
            session.asked = Instant::now();
            if session.version != version {
                return Some(Some(session.news(facts, frame)));
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Some(None);
            }
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Looks for pages that are asleep for as long as the program runs.
    pub fn watch_sleep(&self) {
        loop {
            std::thread::sleep(LOOK_EVERY);
            self.rest();
        }
    }

    /// Forgets the pictures of pages that are asleep, and stops what is made for them. Where their cameras are is kept.
    fn rest(&self) {
        let mut state = self.lock();
        for session in state.sessions.values_mut().filter(|session| session.is_asleep() && session.shown.is_some()) {
            session.shown = None;
            session.begin_anew();
        }
        let of_current = state.current.as_ref().and_then(|job| state.sessions.get(&job.session));
        if of_current.is_some_and(Session::is_asleep) {
            self.stop.store(true, Ordering::Relaxed);
        }
    }

    /// Waits for something to do.
    pub fn next_task(&self) -> Task {
        let mut state = self.lock();
        loop {
            state.current = None;
            self.stop.store(false, Ordering::Relaxed);
            if std::mem::take(&mut state.must_reload) {
                return Task::Reload;
            }
            if let Some(asked) = state.asked.take() {
                return Task::Switch(asked);
            }
            if let Some(job) = state.next_job() {
                state.current = Some(job.clone());
                state.last_served = job.session;
                return Task::Draw(job);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Hands a picture to its page. One of a camera that has moved since is better than an older one.
    pub fn publish(&self, job: &Job, shown: Shown) {
        let mut state = self.lock();
        state.current = None;
        if let Some(session) = state.sessions.get_mut(&job.session) {
            if session.generation == job.generation {
                session.step = (!shown.is_last).then_some(job.step + 1);
                session.divisor = if job.step == 0 { shown.divisor } else { session.divisor };
            }
            if session.layer == job.layer {
                session.shown = Some(shown);
                session.frame += 1;
                session.version += 1;
            }
        }
        self.changed.notify_all();
    }

    /// Gives up a picture that cannot be made, and tells its page why.
    pub fn give_up(&self, job: &Job, why: String) {
        let mut state = self.lock();
        state.current = None;
        if let Some(session) = state.sessions.get_mut(&job.session)
            && session.generation == job.generation
        {
            (session.step, session.refused) = (None, Some(why));
            session.version += 1;
        }
        self.changed.notify_all();
    }

    /// Tells all pages something.
    pub fn tell(&self, change: impl FnOnce(&mut SceneFacts)) {
        let mut state = self.lock();
        change(&mut state.facts);
        state.sessions.values_mut().for_each(|session| session.version += 1);
        self.changed.notify_all();
    }

    /// Has all pictures made anew: of another method, or of another scene, which `camera` sees first.
    pub fn begin_anew(&self, facts: SceneFacts, pickable: Arc<Pickable>, (camera, diagonal): (Camera, f64)) {
        let mut state = self.lock();
        state.facts = facts;
        state.pickable = Some(pickable);
        (state.first_camera, state.diagonal) = (camera, diagonal);
        for session in state.sessions.values_mut() {
            session.navigator.follow(camera, diagonal);
            session.begin_anew();
        }
        self.changed.notify_all();
    }
}

impl State {
    /// The picture that is wanted most: the coarsest, and of several of these that of another page than the last one.
    fn next_job(&self) -> Option<Job> {
        let last = self.last_served;
        let awake = self.sessions.iter().filter(|(_, session)| !session.is_asleep());
        let wanted = awake.filter_map(|(&id, session)| Some((session.step?, id <= last, id, session)));
        let (step, _, session, of) = wanted.min_by_key(|&(step, is_before, id, _)| (step, is_before, id))?;
        let Session { generation, divisor, layer, .. } = *of;
        Some(Job { session, generation, step, divisor, camera: of.navigator.camera(), layer })
    }
}

#[cfg(test)]
mod tests {
    use super::super::session::ASLEEP_AFTER;
    use super::*;
    use raybrook::glam::Vec3;
    use raybrook::low_level::film::Film;

    fn hub() -> Hub {
        let camera = Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
        Hub::new(camera, 1.0, SceneFacts::default())
    }

    fn job(hub: &Hub) -> Job {
        match hub.next_task() {
            Task::Draw(job) => job,
            other => panic!("{other:?}"),
        }
    }

    fn picture(is_last: bool) -> Shown {
        let facts = super::super::facts::PictureFacts::default();
        Shown { film: Arc::new(Film::black(1, 1)), facts, divisor: 8, is_last }
    }

    fn sleep(hub: &Hub, id: u64) {
        hub.lock().sessions.get_mut(&id).unwrap().asked -= ASLEEP_AFTER;
    }

    fn is_stopped(hub: &Hub) -> bool {
        hub.stop.load(Ordering::Relaxed)
    }

    #[test]
    fn the_coarsest_picture_comes_first_and_pages_take_turns() {
        let hub = hub();
        let (a, b) = (hub.begin(), hub.begin());
        for expected in [(a, 0), (b, 0), (a, 1), (b, 1), (a, 2)] {
            let job = job(&hub);
            assert_eq!((job.session, job.step), expected);
            hub.publish(&job, picture(false));
        }
        hub.apply(a, &[Move::Zoom(0.1)]).unwrap();
        assert_eq!((job(&hub).session, job(&hub).step), (a, 0));
    }

    #[test]
    fn moves_stop_what_is_fine_and_leave_what_is_coarse() {
        let hub = hub();
        let id = hub.begin();
        let coarse = job(&hub);
        hub.apply(id, &[Move::Zoom(0.1)]).unwrap();
        assert!(!is_stopped(&hub), "a camera that goes on moving is followed by pictures");
        hub.publish(&coarse, picture(false));
        let again = job(&hub);
        assert_eq!((again.step, again.camera), (0, hub.camera(id).unwrap()));
        hub.publish(&again, picture(false));
        let fine = job(&hub);
        assert_eq!((fine.step, fine.divisor), (1, 8));
        hub.apply(id, &[Move::Fly([0.0; 3])]).unwrap();
        assert!(!is_stopped(&hub), "the camera is where it was");
        hub.apply(id, &[Move::Zoom(0.1)]).unwrap();
        assert!(is_stopped(&hub));
        assert_eq!(job(&hub).step, 0);
        assert!(!is_stopped(&hub));
    }

    #[test]
    fn a_picture_is_finished_until_something_else_is_to_be_shown() {
        let hub = hub();
        let id = hub.begin();
        let is_finished = || hub.finished(id).unwrap().is_some();
        let make = |is_last: bool| hub.publish(&job(&hub), picture(is_last));
        assert!(!is_finished() && hub.finished(id + 1).is_none());
        make(false);
        assert!(!is_finished());
        make(true);
        assert!(is_finished());
        hub.set_exposure(id, 1.0);
        assert!(is_finished());
        for change in
            [&|| hub.apply(id, &[Move::Zoom(0.1)]).unwrap(), &|| hub.set_layer(id, Layer::Wrong).unwrap(), &|| {
                hub.tell(|facts| facts.busy = Some("building".into()))
            }] as [&dyn Fn(); 3]
        {
            change();
            assert!(!is_finished());
            hub.tell(|facts| facts.busy = None);
            if !is_finished() {
                make(true);
            }
            assert!(is_finished());
        }
        hub.set_layer(id, Layer::Picture);
        hub.give_up(&job(&hub), "it is too large".into());
        assert!(!is_finished());
    }

    #[test]
    fn pages_that_sleep_cost_nothing_and_wake_where_they_were() {
        let hub = hub();
        let id = hub.begin();
        hub.apply(id, &[Move::Zoom(0.1)]).unwrap();
        let camera = hub.camera(id).unwrap();
        hub.publish(&job(&hub), picture(false));
        job(&hub);
        sleep(&hub, id);
        hub.rest();
        assert!(is_stopped(&hub) && hub.lock().sessions[&id].shown.is_none());
        assert!(hub.lock().next_job().is_none());
        assert!(hub.news(id, 0, 0).unwrap().is_some());
        let woken = job(&hub);
        assert_eq!((woken.step, woken.camera), (0, camera));
        hub.end(id);
        assert!(is_stopped(&hub) && hub.news(id, 0, 0).is_none());
    }
}
