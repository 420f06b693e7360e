//! Cache files through the C library.

use super::*;

#[test]
fn files_go_round_and_tell_stale_from_corrupt() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(folder.path().join(name).to_str().unwrap());
    let d = device("");
    let s = loaded(&d, "indirect-room");
    let c = cache(&s);
    let points = seen(&s, 1500);
    ok(build(c.0, &points));
    ok(unsafe { lumi_cache_save(c.0, at("a.lumi").as_ptr()) });
    let wanted = ask(c.0, &points, 0);

    let again = cache(&s);
    ok(unsafe { lumi_cache_load(again.0, at("a.lumi").as_ptr(), 0) });
    assert!(
        bits(&ask(again.0, &points, 0).irradiance) == bits(&wanted.irradiance),
        "the file changed a record"
    );
    ok(unsafe { lumi_cache_save(again.0, at("b.lumi").as_ptr()) });
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.lumi") == bytes("b.lumi"));

    // Merging with itself changes nothing; merging two halves gives all.
    ok(unsafe { lumi_cache_merge(again.0, c.0, 0) });
    assert_eq!(stats(again.0).records, stats(c.0).records);
    let other = cache(&s);
    ok(build(other.0, &(points.0[..300].to_vec(), points.1[..300].to_vec())));
    let before = stats(other.0).records;
    ok(unsafe { lumi_cache_merge(other.0, c.0, 0) });
    assert!(
        stats(other.0).records > before && stats(other.0).records <= before + stats(c.0).records
    );

    // Another scene, other settings: stale, unless reuse is wanted.
    let elsewhere = loaded(&d, "cornell-box");
    let foreign = cache(&elsewhere);
    fails(
        unsafe { lumi_cache_load(foreign.0, at("a.lumi").as_ptr(), 0) },
        LUMI_ERROR_STALE_CACHE,
        "geometry",
    );
    fails(unsafe { lumi_cache_merge(foreign.0, c.0, 0) }, LUMI_ERROR_STALE_CACHE, "another scene");
    let finer = cache(&s);
    set(finer.0, "gather.rays", 128);
    fails(
        unsafe { lumi_cache_load(finer.0, at("a.lumi").as_ptr(), 0) },
        LUMI_ERROR_STALE_CACHE,
        "rays 64, not 128",
    );
    ok(unsafe { lumi_cache_load(finer.0, at("a.lumi").as_ptr(), LUMI_REUSE) });
    assert_eq!(stats(finer.0).records, stats(c.0).records);
    fails(
        unsafe { lumi_cache_set_i32(finer.0, c"gather.rays".as_ptr(), 64) },
        LUMI_ERROR_INVALID_OPERATION,
        "clear it",
    );

    // Every damaged byte and every cut is found out, and the cache that was to be replaced is kept.
    let whole = bytes("a.lumi");
    let damaged = |bytes: &[u8]| {
        std::fs::write(folder.path().join("c.lumi"), bytes).unwrap();
        fails(
            unsafe { lumi_cache_load(again.0, at("c.lumi").as_ptr(), 0) },
            LUMI_ERROR_CORRUPT_FILE,
            "c.lumi",
        );
    };
    for k in 0..60 {
        let i = (hash(&[k]) % whole.len() as u64) as usize;
        let mut bytes = whole.clone();
        bytes[i] ^= 1 << (k % 8);
        if (8..12).contains(&i) {
            continue;
        }
        damaged(&bytes);
        damaged(&whole[..i]);
    }
    damaged(b"");
    let mut later = whole.clone();
    later[8] = 99;
    std::fs::write(folder.path().join("c.lumi"), &later).unwrap();
    fails(
        unsafe { lumi_cache_load(again.0, at("c.lumi").as_ptr(), 0) },
        LUMI_ERROR_UNSUPPORTED,
        "later lumicache",
    );
    fails(
        unsafe { lumi_cache_load(again.0, at("none.lumi").as_ptr(), 0) },
        LUMI_ERROR_IO,
        "none.lumi",
    );
    fails(
        unsafe { lumi_cache_save(again.0, at("no/where.lumi").as_ptr()) },
        LUMI_ERROR_IO,
        "where.lumi",
    );
    assert_eq!(stats(again.0).records, stats(c.0).records);
    let litter = std::fs::read_dir(folder.path())
        .unwrap()
        .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
    assert_eq!(litter.count(), 0);
}

#[test]
fn irradiance_of_radiance_records_stays_with_them() {
    let folder = tempfile::tempdir().unwrap();
    let file = text(folder.path().join("a.lumi").to_str().unwrap());
    let d = device("");
    let s = loaded(&d, "cornell-box-glossy");
    let points = seen(&s, 300);
    let zhao = || {
        let c = cache(&s);
        ok(unsafe { lumi_cache_set_str(c.0, c"preset".as_ptr(), c"zhao-view".as_ptr()) });
        ok(unsafe { lumi_cache_set_str(c.0, c"gather.rays".as_ptr(), c"256".as_ptr()) });
        c
    };
    // By default the footprint follows from the cache's extent, which a loaded one brings along.
    let footprints = vec![0.02_f32; points.0.len()];
    let build = |c: &CacheHandle| {
        let seeds = lumi_query { footprint: footprints.as_ptr(), ..query_of(&points) };
        ok(unsafe { lumi_cache_build(c.0, &raw const seeds) });
    };
    let [c, again] = [zhao(), zhao()];
    build(&c);
    let wanted = bits(&ask(c.0, &points, 0).irradiance);
    ok(unsafe { lumi_cache_save(c.0, file.as_ptr()) });
    ok(unsafe { lumi_cache_load(again.0, file.as_ptr(), 0) });
    assert_eq!(stats(again.0).records, stats(c.0).records - stats(c.0).radiance_records);
    build(&again);
    assert!(bits(&ask(again.0, &points, 0).irradiance) == wanted, "the file changed a record");
    ok(unsafe { lumi_cache_merge(again.0, c.0, 0) });
    assert!(bits(&ask(again.0, &points, 0).irradiance) == wanted, "merging changed a record");
    assert_eq!(stats(again.0).records, stats(c.0).records);
}

#[test]
fn records_with_direct_light_go_round() {
    let folder = tempfile::tempdir().unwrap();
    let file = text(folder.path().join("a.lumi").to_str().unwrap());
    let d = device("");
    let s = loaded(&d, "cornell-box");
    let points = seen(&s, 500);
    let with = |contents: &str| {
        let c = cache(&s);
        for (name, value) in [("preset", "aric11"), ("contents", contents), ("gather.rays", "64")] {
            ok(unsafe { lumi_cache_set_str(c.0, text(name).as_ptr(), text(value).as_ptr()) });
        }
        c
    };
    let both = with("direct-and-indirect");
    ok(build(both.0, &points));
    let wanted = ask(both.0, &points, 0).irradiance;
    ok(unsafe { lumi_cache_save(both.0, file.as_ptr()) });
    let again = with("direct-and-indirect");
    ok(unsafe { lumi_cache_load(again.0, file.as_ptr(), 0) });
    assert!(
        bits(&ask(again.0, &points, 0).irradiance) == bits(&wanted),
        "the file changed a record"
    );
    let alone = with("indirect");
    fails(
        unsafe { lumi_cache_load(alone.0, file.as_ptr(), 0) },
        LUMI_ERROR_STALE_CACHE,
        "contents",
    );
    ok(build(alone.0, &points));
    let sum = |e: &[[f32; 3]]| e.iter().flatten().sum::<f32>();
    let indirect = sum(&ask(alone.0, &points, 0).irradiance);
    // In this box direct light is the larger part.
    assert!(sum(&wanted) > 1.5 * indirect, "{} beside {indirect}", sum(&wanted));
}
