// Reads a log with the official readers and fails unless everything in it is as the format says:
//   VIABLE_LOG_READERS=FOLDER node read_mcap.mjs LOG
// FOLDER is where `npm ci` put this folder's packages. Prints the channels and their counts.
import assert from 'node:assert/strict';
import { open } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { join, resolve } from 'node:path';

const require = createRequire(join(resolve(process.env.VIABLE_LOG_READERS ?? '.'), 'package.json'));
const { McapIndexedReader, McapStreamReader } = require('@mcap/core');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader, MessageWriter } = require('@foxglove/rosmsg2-serialization');
const zstd = require('@foxglove/wasm-zstd');

const log = process.argv[2];
if (!log) {
  console.error('usage: VIABLE_LOG_READERS=FOLDER node read_mcap.mjs LOG');
  process.exit(2);
}
await zstd.isLoaded;
const decompressHandlers = { zstd: (bytes, size) => zstd.decompress(bytes, Number(size)) };
const file = await open(log);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, size) => {
    const bytes = new Uint8Array(Number(size));
    const { bytesRead } = await file.read(bytes, 0, bytes.length, Number(offset));
    assert.equal(bytesRead, bytes.length, `the file ends within a read at byte ${offset}`);
    return bytes;
  },
};

/** What one message of a channel must be. */
class Decoder {
  constructor(channel, schema) {
    assert(schema, `${channel.topic}: no schema`);
    assert.equal(schema.encoding, 'ros2msg', `${channel.topic}: encoding of the schema`);
    assert.equal(channel.messageEncoding, 'cdr', `${channel.topic}: encoding of the messages`);
    assert.match(schema.name, /^[a-z][a-z0-9_]*\/msg\/[A-Z][A-Za-z0-9]*$/, `${channel.topic}: no ROS 2 type name`);
    const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
    this.fields = definitions[0].definitions;
    assert(this.fields.length > 0, `${channel.topic}: a schema without fields`);
    for (const field of this.fields)
      assert.match(field.name, /^[a-z](_?[a-z0-9]+)*$/, `${channel.topic}: ROS 2 allows no field "${field.name}"`);
    this.topic = channel.topic;
    this.joints = JSON.parse(channel.metadata.get('joint_names')).length;
    this.written = channel.metadata.get('written') ?? 'each row';
    assert(['each row', 'on_change'].includes(this.written), `${channel.topic}: written ${this.written}`);
    this.reader = new MessageReader(definitions);
    this.writer = new MessageWriter(definitions);
  }

  check(message) {
    const where = `${this.topic}, message ${message.sequence}`;
    const value = this.reader.readMessage(message.data);
    assert(!this.reader.lastReadHadTrailingBytes(), `${where}: bytes that the schema does not name`);
    for (const { name, isArray, arrayLength } of this.fields) {
      assert.notEqual(value[name], undefined, `${where}: no ${name}`);
      if (isArray) assert.equal(value[name].length, arrayLength ?? this.joints, `${where}: length of ${name}`);
    }
    // Alignment and padding, too: what is read and written again is the same.
    assert(Buffer.from(this.writer.writeMessage(value)).equals(Buffer.from(message.data)), `${where}: encoding`);
    return value;
  }
}

/** Counts per channel of a reader's messages, which must decode and not go back in time. */
class Counter {
  counts = new Map();
  #last = -1n;
  #sequences = new Map();

  constructor(decoders) {
    this.decoders = decoders;
  }

  add(message) {
    assert(message.logTime >= this.#last, `time goes back to ${message.logTime} ns after ${this.#last} ns`);
    this.#last = message.logTime;
    const value = this.decoders.get(message.channelId).check(message);
    if (value.time_s !== undefined)
      assert(Math.abs(value.time_s * 1e9 - Number(message.logTime)) <= 1, `time_s ${value.time_s}, log time ${message.logTime} ns`);
    // The sequence is the number of the row.
    const next = this.#sequences.get(message.channelId) ?? 0;
    if (next === 0 || this.decoders.get(message.channelId).written === 'each row')
      assert.equal(message.sequence, next, 'messages of a channel are numbered from 0');
    else assert(message.sequence >= next, 'numbers of messages ascend');
    this.#sequences.set(message.channelId, message.sequence + 1);
    this.counts.set(message.channelId, (this.counts.get(message.channelId) ?? 0n) + 1n);
  }
}

async function readIndexed() {
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const { statistics, channelsById, schemasById, chunkIndexes } = reader;
  assert.equal(reader.header.profile, 'ros2');
  assert.match(reader.header.library, /^viable \d/);
  assert(statistics, 'no statistics');
  assert(chunkIndexes.length > 0, 'no chunk index');
  assert.equal(chunkIndexes.length, statistics.chunkCount, 'chunks in the index');
  assert(channelsById.size > 0, 'no channels');
  assert.equal(channelsById.size, statistics.channelCount, 'channels');
  assert.equal(schemasById.size, statistics.schemaCount, 'schemas');
  for (const chunk of chunkIndexes) {
    assert.equal(chunk.compression, 'zstd');
    assert.equal(chunk.messageIndexOffsets.size, channelsById.size, 'every channel has an index in every chunk');
  }
  assert.equal(chunkIndexes.reduce((least, c) => (c.messageStartTime < least ? c.messageStartTime : least), 1n << 63n),
    statistics.messageStartTime);
  const decoders = new Map(
    [...channelsById].map(([id, channel]) => [id, new Decoder(channel, schemasById.get(channel.schemaId))]),
  );
  const counter = new Counter(decoders);
  for await (const message of reader.readMessages({ validateCrcs: true })) counter.add(message);
  assert.deepEqual(counter.counts, statistics.channelMessageCounts, 'counts of the index and of the statistics');
  assert.equal([...counter.counts.values()].reduce((a, b) => a + b, 0n), statistics.messageCount);

  let attachments = 0;
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) {
    ++attachments;
    assert(attachment.data.length > 0, `${attachment.name} is empty`);
  }
  assert.equal(attachments, statistics.attachmentCount, 'attachments');
  let metadata = 0;
  for await (const entry of reader.readMetadata()) {
    ++metadata;
    assert.equal(entry.name, 'viable');
    assert(entry.metadata.get('version'), 'no version in the metadata');
  }
  assert.equal(metadata, statistics.metadataCount, 'metadata');
  return { decoders, statistics, channelsById };
}

/** From beginning to end, without the index. */
async function readStream({ decoders, statistics }) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  const counter = new Counter(decoders);
  for await (const block of file.createReadStream({ start: 0, autoClose: false })) {
    reader.append(block);
    for (let record; (record = reader.nextRecord()); ) if (record.type === 'Message') counter.add(record);
  }
  assert(reader.done(), 'the file does not end with a footer');
  assert.equal(reader.bytesRemaining(), 0);
  assert.deepEqual(counter.counts, statistics.channelMessageCounts, 'counts of the stream and of the statistics');
}

try {
  const found = await readIndexed();
  await readStream(found);
  for (const [id, { topic }] of found.channelsById)
    console.log(`${topic.padEnd(10)} ${found.statistics.channelMessageCounts.get(id)} messages, ${found.decoders.get(id).fields.length} fields`);
  console.log(`${log}: ${found.statistics.messageCount} messages in ${found.statistics.chunkCount} chunks are as they should be`);
} catch (error) {
  console.error(`${log}: ${error.message}`);
  process.exitCode = 1;
} finally {
  await file.close();
}
