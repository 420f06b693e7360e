//! See the library of this package for what is modelled.

use lumicache_loom::cache::published::Published;
use lumicache_loom::handles::table::Table;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicUsize, Ordering};
use loom::thread;

/// Counts how often it is dropped.
struct Counted(Arc<AtomicUsize>);

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

#[test]
fn a_call_and_a_release_at_once_drop_the_object_once_and_after_the_call() {
    loom::model(|| {
        let (table, dropped) = (Arc::new(Table::new(1)), Arc::new(AtomicUsize::new(0)));
        let handle = table.insert(Counted(dropped.clone())).unwrap();
        let user = {
            let (table, dropped) = (table.clone(), dropped.clone());
            thread::spawn(move || {
                if let Some(object) = table.pin(handle) {
                    assert_eq!(object.0.load(Ordering::SeqCst), 0, "dropped during a call");
                    drop(object);
                } else {
                    // Released before: then the object is gone, or about to be.
                    assert!(table.pin(handle).is_none());
                }
                drop(dropped);
            })
        };
        assert!(table.release(handle));
        user.join().unwrap();
        assert_eq!(dropped.load(Ordering::SeqCst), 1);
        assert!(table.pin(handle).is_none() && !table.release(handle));
    });
}

#[test]
fn of_two_releases_of_one_reference_one_succeeds() {
    loom::model(|| {
        let (table, dropped) = (Arc::new(Table::new(1)), Arc::new(AtomicUsize::new(0)));
        let handle = table.insert(Counted(dropped.clone())).unwrap();
        let other = {
            let table = table.clone();
            thread::spawn(move || table.release(handle))
        };
        let mine = table.release(handle);
        assert!(mine != other.join().unwrap());
        assert_eq!(dropped.load(Ordering::SeqCst), 1);
    });
}

#[test]
fn a_slot_that_is_used_again_is_not_taken_for_the_former() {
    loom::model(|| {
        let table = Arc::new(Table::new(1));
        let first = table.insert(1).unwrap();
        let user = {
            let table = table.clone();
            thread::spawn(move || {
                if let Some(value) = table.pin(first) {
                    assert_eq!(*value, 1);
                }
            })
        };
        assert!(table.release(first));
        // The slot is free only when the call has ended.
        if let Some(second) = table.insert(2) {
            assert_eq!(*table.pin(second).unwrap(), 2);
        }
        user.join().unwrap();
        assert!(table.pin(first).is_none());
    });
}

#[test]
fn a_retained_object_lives_until_the_last_release() {
    loom::model(|| {
        let (table, dropped) = (Arc::new(Table::new(1)), Arc::new(AtomicUsize::new(0)));
        let handle = table.insert(Counted(dropped.clone())).unwrap();
        assert!(table.retain(handle));
        let other = {
            let table = table.clone();
            thread::spawn(move || {
                drop(table.pin(handle));
                assert!(table.release(handle));
            })
        };
        assert!(table.release(handle));
        other.join().unwrap();
        assert_eq!(dropped.load(Ordering::SeqCst), 1);
    });
}

#[test]
fn no_update_is_lost_and_readers_see_whole_versions_in_order() {
    loom::model(|| {
        let published = Arc::new(Published::new((0_u32, 0_u32)));
        let writers: Vec<_> = (0..2)
            .map(|_| {
                let published = published.clone();
                thread::spawn(move || published.update(|(a, b)| Some((a + 1, b + 1))))
            })
            .collect();
        let mut before = 0;
        for _ in 0..2 {
            let (a, b) = published.read(|v| *v);
            assert!(a == b && a >= before);
            before = a;
        }
        assert!(writers.into_iter().all(|w| w.join().unwrap()));
        assert_eq!(*published.get(), (2, 2));
    });
}

#[test]
fn a_change_that_finds_another_generation_stores_nothing() {
    loom::model(|| {
        // As in a lazy fill: what was made for one generation is added only to that.
        let published = Arc::new(Published::new((0_u32, 0_u32)));
        let filler = {
            let published = published.clone();
            thread::spawn(move || {
                let generation = published.get().0;
                published.update(|(g, n)| (*g == generation).then_some((*g, n + 1)))
            })
        };
        published.update(|(g, _)| Some((g + 1, 0)));
        let added = filler.join().unwrap();
        let (g, n) = *published.get();
        assert!(g == 1 && (n == 0 || added), "{n} records of a former cache");
    });
}
