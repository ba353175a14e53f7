#!/usr/bin/env python3
"""Checks the folder of a run with the programs that others use: the documents with event-model, the RO-Crate
with its validator, and every file with the digest in the manifest. Asks no other host: the context of the
RO-Crate is that of the package rocrate.

Usage: folder.py FOLDER
"""

import hashlib
import importlib.resources
import json
import sys
from collections import Counter
from pathlib import Path

import requests
from event_model import DocumentNames, schema_validators
from rocrate_validator import models, services

from bench import check, equal

CONTEXT = importlib.resources.files("rocrate").joinpath("data/ro-crate.jsonld")


def answer(_adapter, request, **_options):
    """The answer to a request of the validator, without the network."""
    response = requests.Response()
    response.url, response.request = request.url, request
    is_context = "/ro/crate/" in request.url and "context" in request.url
    response.status_code = 200 if is_context else 404
    response._content = CONTEXT.read_bytes() if is_context else b""
    response.headers["content-type"] = "application/ld+json"
    return response


def documents(folder):
    counts, streams, events = Counter(), {}, Counter()
    for line in (folder / "documents.jsonl").read_text().splitlines():
        document = json.loads(line)
        name, doc = document["name"], document["doc"]
        schema_validators[DocumentNames[name]].validate(doc)
        counts[name] += 1
        if name == "descriptor":
            streams[doc["uid"]] = (doc["name"], set(doc["data_keys"]))
        if name == "event":
            stream, keys = streams[doc["descriptor"]]
            equal(set(doc["data"]), keys, f"keys of an event of {stream}")
            events[stream] += 1
    equal((counts["start"], counts["descriptor"], counts["stop"]), (1, 2, 1), "documents")
    equal(doc["num_events"], dict(events), "events in the stop document")
    check(all(events.values()), "a stream has no event")
    print(f"documents.jsonl: {sum(counts.values())} documents are those of the event model")


def crate(folder):
    requests.adapters.HTTPAdapter.send = answer
    settings = services.ValidationSettings(
        rocrate_uri=str(folder), profile_identifier="ro-crate-1.1", no_cache=True,
        requirement_severity=models.Severity.RECOMMENDED, abort_on_first=False)
    result = services.validate(settings)
    # rigd does not know who publishes the data, nor where the operators work.
    unknown = ("`publisher`", "affiliation")
    issues = [f"{issue.check.identifier}: {issue.message}" for issue in result.get_issues()
              if not any(word in issue.message for word in unknown)]
    equal(issues, [], "issues of the RO-Crate")
    print("ro-crate-metadata.json: an RO-Crate 1.1, with all that is required, and all that is recommended but a publisher and affiliations")


def manifest(folder):
    listed = json.loads((folder / "manifest.json").read_text())["files"]
    for file in listed:
        found = hashlib.sha256((folder / file["name"]).read_bytes()).hexdigest()
        equal(found, file["sha256"], file["name"])
    names = {file["name"] for file in listed} | {"manifest.json"}
    equal({path.name for path in folder.iterdir()}, names, "files of the folder")
    print(f"manifest.json: {len(listed)} files have their digests")


def main():
    folder = Path(sys.argv[1])
    for part in (documents, crate, manifest):
        part(folder)


main()
