"""Messages of a bag in the order in which they were recorded; what is no bag is one line."""

from mambo_bags import playback
from mambo_bags.reader import read_bag
from mambo_model.schema import ParameterError
import pytest
from synthetic import make_flight

TOPICS = {'/mambo/imu/data_raw', '/mambo/sonar/range'}


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return make_flight(tmp_path_factory.mktemp('bags') / 'flight', 2.0)


def test_the_named_topics_come_in_the_order_of_their_log_time(flight):
    played = list(playback.recorded(flight, TOPICS))
    bag = read_bag(flight)
    assert {topic for topic, _, _ in played} == TOPICS
    for topic in TOPICS:
        assert [data for name, _, data in played if name == topic] == bag[topic].raw
        assert {kind for name, kind, _ in played if name == topic} == {bag.topics[topic]}
    left = {topic: iter(bag[topic].log_time.tolist()) for topic in TOPICS}
    times = [next(left[topic]) for topic, _, _ in played]
    assert times == sorted(times)
    assert list(playback.recorded(flight, {'/nothing'})) == []


def test_a_folder_a_file_and_a_folder_without_a_listing_are_bags(flight, tmp_path):
    file, = playback.bag_files(flight)
    assert playback.bag_files(file) == [file]
    (tmp_path / 'b.mcap').write_bytes(file.read_bytes())
    (tmp_path / 'a.mcap').write_bytes(file.read_bytes())
    assert playback.bag_files(tmp_path) == [tmp_path / 'a.mcap', tmp_path / 'b.mcap']


@pytest.mark.parametrize(('text', 'message'), [
    ('rosbag2_bagfile_information: {relative_file_paths: [gone.mcap]}',
     'gone.mcap: listed in metadata.yaml but missing'),
    ('rosbag2_bagfile_information: {relative_file_paths: []}', 'not a bag'),
    ('rosbag2_bagfile_information: 3', 'metadata.yaml: not the metadata of a rosbag2 bag'),
    ('a: [', 'metadata.yaml: not the metadata'), ('', 'metadata.yaml: not the metadata'),
    ('[1]', 'metadata.yaml: not the metadata')])
def test_a_listing_that_does_not_fit_is_one_line(tmp_path, text, message):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(ParameterError, match=message) as refused:
        playback.bag_files(tmp_path)
    assert '\n' not in str(refused.value)


def test_what_is_no_bag_is_one_line(tmp_path):
    for path in (tmp_path, tmp_path / 'none'):
        with pytest.raises(ParameterError, match='not a bag; give a rosbag2 directory'):
            playback.bag_files(path)


@pytest.mark.parametrize('share', [0.0, 0.3, 0.9])
def test_a_file_cut_short_is_told_and_recover_is_named(flight, tmp_path, share):
    content = playback.bag_files(flight)[0].read_bytes()
    file = tmp_path / 'cut.mcap'
    file.write_bytes(content[:round(share * len(content))])
    with pytest.raises(ParameterError, match='cut.mcap: not a readable MCAP file .*try recover'):
        list(playback.recorded(file, TOPICS))
