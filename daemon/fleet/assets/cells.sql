-- One row for each cell of the store, as the page shows it; of its days a list each, in order.
-- $first, $last: the days shown; $since: the beginning of the weeks before them.
-- The table `calibrated` has, by cell, the first and the last day that give its usual camera angles.
WITH days AS (
    SELECT unnest(generate_series($first::DATE, $last::DATE, INTERVAL 1 DAY))::DATE AS day
), ever AS (  -- last: the end of the last run, which lasts for days on an idle cell
    SELECT cell, max(t + to_milliseconds((1000 * coalesce(seconds, 0))::BIGINT))::TIMESTAMP AS last
    FROM runs GROUP BY cell
), totals AS (
    SELECT cell, count(*) AS runs, sum(interventions) AS interventions, arg_max(release, t) AS release
    FROM runs WHERE day BETWEEN $first AND $last GROUP BY cell
), before AS (
    SELECT cell, [count(*) FILTER (outcome = 'picked'), count(*)] AS share
    FROM cycles WHERE tried AND day >= $since AND day < $first GROUP BY cell
), shown AS (
    SELECT * FROM cycles LEFT JOIN (SELECT cell, run, times_life FROM runs) USING (cell, run)
    WHERE day BETWEEN $first AND $last
), picks_of_day AS (
    SELECT cell, day, count(*) FILTER (outcome = 'picked') AS picked, count(*) AS tried,
        median(seconds) FILTER (outcome = 'picked' AND coalesce(times_life, 1) = 1) AS seconds,
        median(predicted_mm::DOUBLE) FILTER (outcome = 'picked') AS mm
    FROM shown WHERE tried GROUP BY cell, day
), picks AS (
    SELECT cell, sum(coalesce(picked, 0))::BIGINT AS picked, sum(coalesce(tried, 0))::BIGINT AS tried,
        list([coalesce(picked, 0), coalesce(tried, 0)] ORDER BY day) AS success,
        list(seconds ORDER BY day) AS seconds, list(mm ORDER BY day) AS mm
    FROM ever CROSS JOIN days LEFT JOIN picks_of_day USING (cell, day) GROUP BY cell
), images_of_day AS (
    SELECT cell, day, angle(pitch_deg, pitch_sigma_deg) AS pitch, angle(roll_deg, roll_sigma_deg) AS roll,
        angle(vergence_deg, vergence_sigma_deg) AS vergence,
        median(least(darkness_left, darkness_right)::DOUBLE) AS light, median(epipolar_pair::DOUBLE) AS epipolar
    FROM health WHERE day BETWEEN $first AND $last GROUP BY cell, day
), images AS (
    SELECT cell,
        {pitch: list(pitch ORDER BY day), roll: list(roll ORDER BY day), vergence: list(vergence ORDER BY day)} AS turn,
        list(light ORDER BY day) AS light, list(epipolar ORDER BY day) AS epipolar
    FROM ever CROSS JOIN days LEFT JOIN images_of_day USING (cell, day) GROUP BY cell
), usual AS (
    SELECT cell, angle(pitch_deg, pitch_sigma_deg) AS pitch, angle(roll_deg, roll_sigma_deg) AS roll,
        angle(vergence_deg, vergence_sigma_deg) AS vergence
    FROM health JOIN calibrated USING (cell) WHERE day BETWEEN first_day AND last_day GROUP BY cell
), looked AS (
    SELECT cell, median(ms::DOUBLE) AS ms, arg_max(eyes, (t, seq)) AS cameras, count(*) FILTER (eyes <> 'both') AS one
    FROM looks WHERE day BETWEEN $first AND $last GROUP BY cell
), parts AS (
    SELECT cell, map_from_entries(list((part, share) ORDER BY part)) AS parts FROM (
        SELECT cell, coalesce(label, $none_chosen) AS part, [count(*) FILTER (outcome = 'picked'), count(*)] AS share
        FROM shown WHERE tried GROUP BY cell, part
    ) GROUP BY cell
), placed AS (
    SELECT cell, [count(*) FILTER (place_status = $looked_at[1]), count(*) FILTER (place_status = $looked_at[2]),
        count(*) FILTER (place_status = $looked_at[3])] AS placed
    FROM shown GROUP BY cell
), causes AS (
    SELECT cell, map_from_entries(list((cause, n) ORDER BY n DESC, cause)) AS causes
    FROM (SELECT cell, cause, count(*) AS n FROM shown WHERE cause IS NOT NULL GROUP BY cell, cause) GROUP BY cell
), stopped AS (
    SELECT cell, list({code: code, text: text, count: n}) AS faults FROM (
        SELECT cell, code, text, count(*) AS n FROM faults
        WHERE kind = 'fault' AND day BETWEEN $first AND $last GROUP BY cell, code, text
    ) GROUP BY cell
)
SELECT cell AS name, last, coalesce(runs, 0) AS runs,
    coalesce(interventions, 0)::BIGINT AS interventions, release, picked, tried, coalesce(share, [0, 0]) AS before,
    success, seconds, mm, coalesce(parts, MAP {}) AS parts, coalesce(placed, [0, 0, 0]) AS placed,
    coalesce(causes, MAP {}) AS causes, coalesce(faults, []) AS faults, ms, cameras, coalesce(one, 0) AS one_camera, turn,
    {pitch: usual.pitch, roll: usual.roll, vergence: usual.vergence} AS usual, light, epipolar
FROM ever JOIN picks USING (cell) JOIN images USING (cell)
    LEFT JOIN totals USING (cell) LEFT JOIN before USING (cell) LEFT JOIN usual USING (cell) LEFT JOIN looked USING (cell)
    LEFT JOIN parts USING (cell) LEFT JOIN placed USING (cell) LEFT JOIN causes USING (cell)
    LEFT JOIN stopped USING (cell)
ORDER BY cell
