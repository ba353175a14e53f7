"""Ships runs to a simulated S3 of another maker, breaks off in between, ships again, and verifies the bucket.

Usage: s3.py RIGD DATA      (RIGD with the feature s3; needs moto[server] and boto3)
"""

import json
import os
import subprocess
import sys

import boto3
from moto.server import ThreadedMotoServer

rigd, data = sys.argv[1:3]
server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
server.start()
host, port = server.get_host_and_port()
url = f"http://{host}:{port}"
environment = os.environ | {
    "AWS_ACCESS_KEY_ID": "somebody",
    "AWS_SECRET_ACCESS_KEY": "secret",
    "AWS_REGION": "us-east-1",
    "AWS_ENDPOINT_URL": url,
    "AWS_ALLOW_HTTP": "true",
}
client = boto3.client(
    "s3", endpoint_url=url, region_name="us-east-1", aws_access_key_id="somebody", aws_secret_access_key="secret"
)
client.create_bucket(Bucket="rigs")


def run(*arguments, expected=0, **changes):
    command = [rigd, *arguments, "--json"]
    done = subprocess.run(command, env=environment | changes, capture_output=True, text=True, check=False)
    assert done.returncode == expected, f"{arguments}: {done.returncode}: {done.stderr}"
    return done.stderr if expected in (1, 3) else json.loads(done.stdout)


def ship(**options):
    return [run["outcome"] for run in run("ship", "s3://rigs/soft", "--bench", "left", "--data", data, **options)]


def keys():
    return sorted(entry["Key"] for entry in client.list_objects_v2(Bucket="rigs").get("Contents", []))


said = run("ship", "s3://rigs/soft", "--data", data, expected=1, AWS_ALLOW_HTTP="false")
assert "AWS_ALLOW_HTTP" in said and not keys(), said
first = ship()
assert first and set(first) == {"shipped"}, first
objects = keys()
assert len(objects) == 2 * len(first) and all(key.startswith("soft/lab=lab/bench=left/month=") for key in objects), objects
tags = {key: client.head_object(Bucket="rigs", Key=key)["ETag"] for key in objects}
assert set(ship()) == {"present"}

# The program was broken off before a receipt, and before an object.
receipts = [key for key in objects if key.endswith(".json")]
client.delete_object(Bucket="rigs", Key=receipts[0])
assert set(ship()) == {"present"}
lost = [key for key in objects if key.endswith(".parquet")][0]
client.delete_object(Bucket="rigs", Key=lost)
assert sorted(set(ship())) == ["present", "shipped"]
assert {key: client.head_object(Bucket="rigs", Key=key)["ETag"] for key in keys()} == tags, "the same bytes"
assert all(verdict["is_sound"] for verdict in run("verify", "s3://rigs/soft"))

# What somebody else has put there is neither taken for the run nor written over.
client.delete_object(Bucket="rigs", Key=receipts[0])
for key in objects:
    if key.endswith(".parquet") and key.rsplit("/", 1)[1][:-8] in receipts[0]:
        client.put_object(Bucket="rigs", Key=key, Body=b"PAR1")
        refused = run("ship", "s3://rigs/soft", "--bench", "left", "--data", data, expected=7)
        assert sorted({one["outcome"] for one in refused}) == ["present", "refused"], refused
        assert client.get_object(Bucket="rigs", Key=key)["Body"].read() == b"PAR1"
run("verify", "s3://rigs/soft", expected=7)
run("verify", "s3://rigs/nothing", expected=3)
run("ship", "s3://missing", "--data", data, expected=1)
server.stop()
print(f"{len(first)} objects in a bucket: put once, shipped again after a break, and sound")
