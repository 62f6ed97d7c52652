from articulate.formats.repairs import Repairs, is_note


def test_each_message_occurs_once_in_the_order_of_work():
    repairs = Repairs()
    for message in ("joint a: turned", "mesh x.obj: flat", "joint a: turned"):
        repairs.add(message)
    repairs.note("textures")
    assert repairs.messages == ("joint a: turned", "mesh x.obj: flat", "note: textures")


def test_equal_messages_about_many_meshes_become_one():
    repairs = Repairs()
    for k in range(5):
        repairs.note(f"mesh m{k}.obj: the back left out")
        repairs.add(f"mesh m{k}.obj: a hole, closed")
    repairs.add("mesh m0.obj: cannot be read")
    first = "meshes m0.obj, m1.obj, m2.obj and 2 more"
    assert repairs.messages == (
        f"note: {first}: the back left out",
        f"{first}: a hole, closed",
        "mesh m0.obj: cannot be read",
    )
    assert [is_note(s) for s in repairs.messages] == [True, False, False]


def test_going_back_keeps_messages_about_many():
    repairs = Repairs()
    for k in range(4):
        repairs.add(f"mesh m{k}.obj: flat")
    read = repairs.messages
    repairs.add("part p: joined")
    repairs.restore(read)
    assert repairs.messages == read
