// Reads logs with the reader that the viewers use, and holds them against what it promises to viewers.
//
// node check_log.mjs LOG.mcap...: counts what holds and what does not. What is printed last is read by .ci/run.

import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { decompress } from "fzstd";
import { open, readFile } from "node:fs/promises";
import { basename } from "node:path";

const decompressHandlers = { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) };

const TOPICS = [
  "/em/bone_residuals", "/em/likelihood", "/log", "/markers/raw", "/markers/repaired", "/skeleton", "/take/bone_lengths", "/take/marker_state", "/tf",
];

let passed = 0, failed = 0;
function check(what, holds, found) {
  if (holds) passed++;
  else failed++;
  if (!holds) console.log(`failed: ${what}${found === undefined ? "" : `: ${found}`}`);
}

/** From the first byte to the last: every checksum, the order of times in the file, the number of records. */
async function stream(name, bytes) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  reader.append(bytes);
  const counts = new Map();
  let latest = -1n, ordered = true, equal = true;
  for (let record; (record = reader.nextRecord()); ) {
    counts.set(record.type, (counts.get(record.type) ?? 0) + 1);
    if (record.type === "Message") {
      ordered &&= record.logTime >= latest;
      equal &&= record.logTime === record.publishTime;
      latest = record.logTime;
    }
  }
  check(`${name}: read to its end`, reader.done());
  check(`${name}: messages are in the order of their times`, ordered);
  check(`${name}: publish time is log time`, equal);
  return counts;
}

/** Through the index, as viewers do. */
async function indexed(name, path, counts) {
  const file = await open(path);
  const { size } = await file.stat();
  const readable = {
    size: async () => BigInt(size),
    read: async (offset, length) => {
      const bytes = new Uint8Array(Number(length));
      await file.read(bytes, 0, Number(length), Number(offset));
      return bytes;
    },
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const { statistics, chunkIndexes, channelsById, schemasById } = reader;
  const topics = [...channelsById.values()].map((channel) => channel.topic).sort();
  check(`${name}: every topic is declared once`, topics.join() === TOPICS.join(), topics);
  check(`${name}: every channel has a schema of its own kind`, [...channelsById.values()].every((c) => c.messageEncoding === "protobuf" && schemasById.get(c.schemaId)?.encoding === "protobuf"));
  check(`${name}: the index knows every message`, Number(statistics.messageCount) === (counts.get("Message") ?? 0), statistics.messageCount);
  check(`${name}: the index knows every chunk`, chunkIndexes.length === (counts.get("Chunk") ?? chunkIndexes.length));
  check(`${name}: no chunks overlap`, chunkIndexes.every((chunk, at) => at === 0 || chunk.messageStartTime >= chunkIndexes[at - 1].messageEndTime));
  let read = 0;
  const perTopic = new Map();
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    read++;
    const topic = channelsById.get(message.channelId).topic;
    perTopic.set(topic, (perTopic.get(topic) ?? 0) + 1);
  }
  check(`${name}: reading through the index finds every message`, read === Number(statistics.messageCount), read);
  check(`${name}: the two topics of each iteration go together`, perTopic.get("/em/likelihood") === perTopic.get("/em/bone_residuals"));

  // half a second from the middle, as when somebody jumps there
  const middle = (statistics.messageStartTime + statistics.messageEndTime) / 2n;
  let outside = 0, inside = 0;
  for await (const message of reader.readMessages({ startTime: middle, endTime: middle + 500_000_000n, topics: ["/take/marker_state"] })) {
    if (message.logTime < middle || message.logTime > middle + 500_000_000n) outside++;
    else inside++;
  }
  check(`${name}: a jump to the middle finds its messages`, outside === 0 && inside > 0, `${inside} inside, ${outside} outside`);

  const attachments = [];
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) attachments.push(attachment.name);
  check(`${name}: options, report, take and layout are attached`, ["config.toml", "report.jsonl", "take.json", "layout.json"].every((a) => attachments.includes(a)), attachments);
  for await (const attachment of reader.readAttachments({ name: "layout.json" })) {
    const layout = JSON.parse(new TextDecoder().decode(attachment.data));
    check(`${name}: the layout has panels`, Object.keys(layout.configById).length >= 5);
  }
  const metadata = [];
  for await (const record of reader.readMetadata()) metadata.push(record.name);
  check(`${name}: one metadata record`, metadata.join() === "mocap-repair", metadata);
  await file.close();
}

for (const path of process.argv.slice(2)) {
  const name = basename(path);
  const bytes = await readFile(path);
  const counts = await stream(name, bytes);
  await indexed(name, path, counts);
  // one changed byte must not go unseen, or the checks above would mean little
  const bad = new Uint8Array(bytes);
  bad[bad.length >> 1] ^= 1;
  let seen = false;
  try {
    await stream(`${name}, damaged`, bad);
  } catch {
    seen = true;
  }
  check(`${name}: damage is seen`, seen);
}
console.log(`${passed} passed, ${failed} failed`);
process.exitCode = failed > 0 || passed === 0 ? 1 : 0;
