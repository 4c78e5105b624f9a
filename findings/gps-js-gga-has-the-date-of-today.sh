#!/usr/bin/env bash
# gps 0.9.0 for npm (GPS.js), which reads NMEA logs of receivers: RMC has date and time, GGA and GLL the time alone. One
# would expect their `time` to have the date of the RMC beside them, or to be no Date. It is a Date on the day on which
# the log is read, and so is gps.state.time after each of them.
# It hurts those who make routes from recorded logs: fixes with height (GGA) and with speed (RMC) of one second lie
# years apart, a drive over midnight jumps back by a day, and pictures find no fix at their time, without a word.
# Seen, of the last second of 2020 and the next: RMC 1 s apart, GGA and GLL -86399 s and of today. Needs node and npm.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
npm install --silent --no-audit --no-fund gps@0.9.0 >npm.log 2>&1
node - <<'END'
const {GPS} = require("gps");
const checksum = (text) => Buffer.from(text).reduce((sum, byte) => sum ^ byte, 0).toString(16).padStart(2, "0");
const gps = new GPS(), times = {RMC: [], GGA: [], GLL: []};
let right = true;
for (const [time, date] of [["235959.00", "311220"], ["000000.00", "010121"]]) {
  const place = "4800.0000,N,01100.0000,E";
  for (const text of [`GPRMC,${time},A,${place},10.0,90.0,${date},,,A`,
                      `GPGGA,${time},${place},1,08,0.9,520.0,M,47.0,M,,`, `GPGLL,${place},${time},A,A`]) {
    const line = `$${text}*${checksum(text)}`, record = GPS.Parse(line);
    right &&= gps.update(line) && record.valid && gps.state.time.getTime() === record.time.getTime();
    times[record.type].push(record.time);
    console.log(record.type, "time and state", record.time.toISOString(), gps.state.time.toISOString());
  }
}
right &&= times.RMC[0].toISOString() === "2020-12-31T23:59:59.000Z" && times.RMC[1] - times.RMC[0] === 1000;
const ofToday = ([first, second]) => second - first === -86399e3 && Math.abs(first - Date.now()) <= 86400e3;
process.exitCode = right && ofToday(times.GGA) && ofToday(times.GLL) ? 0 : 1;
END
